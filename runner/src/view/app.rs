//! The window and its events.

mod device;
mod options;
mod orders;

use std::{
    path::PathBuf,
    sync::Arc,
    time::{Duration, Instant},
};

use egui::{Context, ViewportId};
use winit::{
    application::ApplicationHandler,
    dpi::PhysicalSize,
    event::{StartCause, WindowEvent},
    event_loop::{ActiveEventLoop, ControlFlow, EventLoop, EventLoopProxy},
    window::{Window, WindowId},
};

pub use self::options::{Options, Processor, ViewError};
use super::{
    driver::Driver,
    panels,
    screen::{Painted, Painting, Screen, Textures},
    state::State,
    watch::Watch,
    worker::{Job, News, Worker},
};
use crate::{
    executor::gpu::AdapterChoice,
    output::{Destination, png},
    scene::Camera,
};

/// Losses of the GPU after which the host computes.
const MOST_LOSSES: u32 = 3;
/// Pixels of a picture to one of the window where the host computes: a frame takes a quarter of a second there, not four.
const HOST_SCALE: f32 = 0.25;

/// What wakes the window.
#[derive(Debug)]
enum Wake {
    /// The thread has something new.
    Thread,
    /// Something in the interface moves.
    Repaint(Duration),
    /// A file was chosen.
    Chosen(PathBuf),
    /// There is no file dialog.
    NoDialog,
    /// A file of the scene has changed.
    Changed,
}

/// Whether there is a display to open a window on.
pub fn has_display() -> bool {
    let named = |name: &str| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    !cfg!(all(unix, not(target_os = "macos"))) || named("DISPLAY") || named("WAYLAND_DISPLAY")
}

/// Opens the window and stays until it is closed.
///
/// # Errors
/// If there is no display, or nothing can draw on it.
pub fn run(options: Options) -> Result<(), ViewError> {
    let no_display = |error: winit::error::EventLoopError| ViewError::NoDisplay(error.to_string());
    let event_loop = EventLoop::<Wake>::with_user_event().build().map_err(no_display)?;
    let mut app = App::new(options, event_loop.create_proxy());
    event_loop.run_app(&mut app).map_err(no_display)?;
    app.end.unwrap_or(Ok(()))
}

/// The window, once it is there.
struct Live {
    window: Arc<Window>,
    input: egui_winit::State,
}

struct App {
    state: State,
    camera: Option<Camera>,
    adapter: AdapterChoice,
    processor: Processor,
    scale: Option<f32>,
    size: [u32; 2],
    frames: Option<u32>,
    screenshot: Option<PathBuf>,
    driver: Driver,
    context: Context,
    proxy: EventLoopProxy<Wake>,
    worker: Worker,
    live: Option<Live>,
    screen: Option<Screen>,
    textures: Textures,
    losses: u32,
    serial: u64,
    last: Instant,
    hidden: bool,
    repaint_at: Option<Instant>,
    tree: Vec<(String, egui::Pos2)>,
    watch: Option<Watch>,
    end: Option<Result<(), ViewError>>,
    started: Instant,
}

impl App {
    fn new(options: Options, proxy: EventLoopProxy<Wake>) -> Self {
        let context = Context::default();
        let repaint = proxy.clone();
        context.set_request_repaint_callback(move |info| drop(repaint.send_event(Wake::Repaint(info.delay))));
        let wake = proxy.clone();
        // Nobody listens any more once the loop has ended.
        let worker = Worker::start(move || drop(wake.send_event(Wake::Thread)));
        // While the window opens, the scene is read.
        worker.send(Job::Open(options.state.choice.clone()));
        let mut state = options.state;
        if let Some(folder) = options.record {
            state.recording = Some(folder.clone());
            worker.send(Job::Record(Some(folder)));
        }
        if !options.script.is_empty() {
            // Widgets are found by their names.
            context.enable_accesskit();
        }
        Self {
            state,
            camera: options.camera,
            adapter: options.adapter,
            processor: options.processor,
            scale: options.scale,
            size: options.size,
            frames: options.frames,
            screenshot: options.screenshot,
            driver: Driver::new(options.script),
            context,
            proxy,
            worker,
            live: None,
            screen: None,
            textures: Textures::default(),
            losses: 0,
            serial: 0,
            last: Instant::now(),
            hidden: false,
            repaint_at: None,
            tree: Vec::new(),
            watch: None,
            end: None,
            started: Instant::now(),
        }
    }

    /// Makes the window and what draws in it.
    fn open(&mut self, event_loop: &ActiveEventLoop) -> Result<(), ViewError> {
        let attributes = Window::default_attributes()
            .with_title("weir")
            .with_inner_size(PhysicalSize::new(self.size[0], self.size[1]));
        let window = event_loop.create_window(attributes).map_err(|e| ViewError::NoWindow(e.to_string()))?;
        let window = Arc::new(window);
        self.make_screen(&window)?;
        let scale = Some(window.scale_factor() as f32);
        let side = self.screen.as_ref().map(Screen::max_texture_side);
        let input =
            egui_winit::State::new(self.context.clone(), ViewportId::ROOT, &window, scale, window.theme(), side);
        self.live = Some(Live { window, input });
        Ok(())
    }

    /// News from the thread.
    fn hear(&mut self) {
        let outbox = self.worker.outbox();
        self.state.busy = outbox.busy;
        self.state.resting = outbox.resting;
        if outbox.serial > self.serial {
            self.serial = outbox.serial;
            if let Some(frames) = outbox.frame {
                if self.state.frames.is_none() {
                    tracing::info!("first picture after {:.2} s", self.started.elapsed().as_secs_f64());
                }
                self.state.stats.add(outbox.frame_time, &frames.times);
                if let Some(budget) = frames.budget {
                    self.state.stats.add_budget(budget.frame, budget.level);
                }
                self.state.frames = Some(frames);
            }
            let now = Instant::now();
            // Recordings move on by the same step, however long a picture takes.
            let passed = if self.state.recording.is_some() { 1.0 / 30.0 } else { (now - self.last).as_secs_f32() };
            self.state.advance(passed.min(0.25));
            self.last = now;
        }
        for news in self.worker.news() {
            match news {
                News::GpuFailed(error) => self.recover(&error),
                news => {
                    let opened = matches!(news, News::Opened { .. });
                    self.state.hear(news);
                    if opened {
                        self.opened();
                    }
                }
            }
        }
        if !self.worker.is_alive() {
            self.end = Some(Err(ViewError::Thread));
        }
    }

    fn opened(&mut self) {
        if let Some(camera) = self.camera.take() {
            self.state.rig.go(camera);
        }
        if let Some(live) = &self.live {
            live.window.set_title(&format!("{} - weir", self.state.facts.name));
        }
        let proxy = self.proxy.clone();
        let file = self.state.choice.file().map(std::path::Path::to_owned);
        self.watch = file.and_then(|file| {
            let watch = Watch::new(&file, move || drop(proxy.send_event(Wake::Changed)));
            watch.inspect_err(|reason| tracing::warn!("{} is not watched: {reason}", file.display())).ok()
        });
    }

    /// One pass of the interface, and what it looks like on the screen.
    fn redraw(&mut self, event_loop: &ActiveEventLoop) {
        self.hear();
        self.drive();
        let Some(live) = &mut self.live else { return };
        let input = live.input.take_egui_input(&live.window);
        let state = &mut self.state;
        state.pixels_per_point = egui_winit::pixels_per_point(&self.context, &live.window);
        let output = self.context.run_ui(input, |ui| panels::window(ui, state));
        if let Some(tree) = &output.platform_output.accesskit_update {
            self.tree = orders::named_widgets(tree, output.pixels_per_point);
        }
        live.input.handle_platform_output(&live.window, output.platform_output);
        let delay = output.viewport_output.get(&ViewportId::ROOT).map_or(Duration::MAX, |view| view.repaint_delay);
        self.repaint_at = Instant::now().checked_add(delay);
        let primitives = self.context.tessellate(output.shapes, output.pixels_per_point);
        self.textures.update(&output.textures_delta);
        self.follow_orders();

        let frames = self.state.frames.clone();
        let scale = output.pixels_per_point;
        let painting = Painting {
            frames: frames.as_deref().map(|frames| (frames, self.serial)),
            place: self.state.place.map(|points| points * scale),
            divider: self.state.divider,
            smooth: self.state.smooth && self.state.view == super::buffers::View::Picture,
            primitives: &primitives,
            textures: &output.textures_delta,
            all_textures: &self.textures,
            pixels_per_point: scale,
        };
        let Some(screen) = &mut self.screen else { return };
        screen.set_vsync(self.state.vsync);
        let mut painted = screen.paint(&painting);
        if matches!(painted, Ok(Painted::Again)) {
            let nothing_new = egui::TexturesDelta::default();
            painted = screen.paint(&Painting { textures: &nothing_new, ..painting });
        }
        self.hidden = matches!(painted, Ok(Painted::Hidden));
        let counted = self.frames.is_some_and(|frames| self.serial >= u64::from(frames) || self.state.resting);
        let capture = if self.frames.is_none() || counted { self.screenshot.take() } else { None };
        let captured = capture.map(|path| {
            let nothing_new = egui::TexturesDelta::default();
            let contents = screen.capture(&Painting { textures: &nothing_new, ..painting });
            contents.map(|(size, pixels)| (path, size, pixels))
        });
        self.textures.free(&output.textures_delta);
        match captured {
            Some(Ok((path, [width, height], pixels))) => {
                match png::write(&Destination::File(path.clone()), width, height, &pixels) {
                    Ok(()) => self.state.say(format!("saved {}", path.display())),
                    Err(error) => self.end = Some(Err(ViewError::Script(error.to_string()))),
                }
            }
            Some(Err(error)) => self.recover(&error),
            None => {}
        }
        if let Err(error) = painted {
            self.recover(&error);
        }
        if counted && self.end.is_none() {
            self.end = Some(Ok(()));
        }
        // A window that can't be seen takes no pictures, so none are computed.
        if let Some(want) = self.state.want().filter(|_| !self.hidden) {
            self.worker.want(&want, self.serial);
        }
        if self.end.is_some() {
            event_loop.exit();
        }
    }

    fn request_redraw(&self) {
        if let Some(live) = &self.live {
            live.window.request_redraw();
        }
    }
}

impl ApplicationHandler<Wake> for App {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        event_loop.set_control_flow(ControlFlow::Wait);
        if self.live.is_none()
            && let Err(error) = self.open(event_loop)
        {
            self.end = Some(Err(error));
            event_loop.exit();
        }
        self.request_redraw();
    }

    fn new_events(&mut self, _: &ActiveEventLoop, cause: StartCause) {
        if matches!(cause, StartCause::ResumeTimeReached { .. }) {
            self.repaint_at = None;
            self.request_redraw();
        }
    }

    fn user_event(&mut self, event_loop: &ActiveEventLoop, wake: Wake) {
        match wake {
            Wake::Thread => {}
            Wake::Repaint(delay) if delay > Duration::ZERO => {
                let at = Instant::now().checked_add(delay);
                self.repaint_at = self.repaint_at.into_iter().chain(at).min();
                return;
            }
            Wake::Repaint(_) => {}
            Wake::Chosen(path) => self.state.take_file(path),
            Wake::NoDialog => self.state.fail(
                "this system shows no file dialog (on Linux: install xdg-desktop-portal or zenity); drop a file on the window instead",
            ),
            Wake::Changed => self.state.act(super::keys::Action::Reload),
        }
        self.request_redraw();
        if self.end.is_some() {
            event_loop.exit();
        }
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let Some(live) = &mut self.live else { return };
        let response = live.input.on_window_event(&live.window, &event);
        match event {
            WindowEvent::RedrawRequested => {
                self.redraw(event_loop);
                return;
            }
            WindowEvent::CloseRequested | WindowEvent::Destroyed => event_loop.exit(),
            WindowEvent::Resized(size) => {
                if let Some(screen) = &mut self.screen {
                    screen.resize([size.width, size.height]);
                }
            }
            _ => {}
        }
        if response.repaint {
            self.request_redraw();
        }
    }

    fn about_to_wait(&mut self, event_loop: &ActiveEventLoop) {
        // A script goes on by itself.
        let script = (!self.driver.is_done()).then(|| Instant::now() + Duration::from_millis(10));
        let next = self.repaint_at.into_iter().chain(script).min();
        event_loop.set_control_flow(next.map_or(ControlFlow::Wait, ControlFlow::WaitUntil));
    }
}
