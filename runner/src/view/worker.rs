//! The thread that computes pictures.

use std::{
    collections::VecDeque,
    path::PathBuf,
    sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError},
    thread::JoinHandle,
    time::{Duration, Instant},
};

use glam::UVec2;

use super::{
    engine::{Engine, EngineError, Frames, SceneFacts},
    pick::Picked,
    save,
    want::Want,
};
use crate::{
    executor::gpu::{Gpu, GpuError},
    render::RenderError,
    scene::{Camera, choice::Choice, environment},
    settings::Settings,
    skips::Cost,
};

/// Something to do between frames.
pub enum Job {
    /// Another scene.
    Open(Choice),
    /// Another environment map.
    Environment(PathBuf),
    /// Go on there, or on the host.
    Use(Option<Gpu>),
    /// What is under a pixel, and what for.
    Pick(UVec2, Purpose),
    /// Make a light an instance of its own.
    TakeLight(Picked),
    /// The picture as PNG or EXR, by the ending of the name.
    Save(PathBuf),
    /// Every picture from now on into a folder, or no more.
    Record(Option<PathBuf>),
    /// What leaving work out saves.
    Measure,
}

/// What a pick is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// The camera turns to it.
    Focus,
    /// It is edited, if it is a light.
    Light,
}

/// What has happened.
pub enum News {
    /// A scene is there.
    Opened {
        /// What is known of it.
        facts: SceneFacts,
        /// Its camera.
        home: Camera,
        /// What was wrong with it.
        warnings: Vec<String>,
        /// How it was named.
        choice: Choice,
    },
    /// The scene has other facts than before.
    Changed(SceneFacts),
    /// Something did not work; the window goes on with what there is.
    Failed(String),
    /// The GPU failed; no frames until [`Job::Use`].
    GpuFailed(GpuError),
    /// Something was written.
    Saved(PathBuf),
    /// What was found under a pixel.
    Found(Option<Picked>, Purpose),
    /// A light is an instance of its own now.
    LightTaken(u32),
    /// What leaving work out saves.
    Measured {
        /// The knobs with which it does.
        settings: Box<Settings>,
        /// Without any rule, with each alone and with all.
        costs: Vec<Cost>,
    },
}

/// What the thread is to do.
#[derive(Default)]
struct Inbox {
    want: Option<Want>,
    jobs: VecDeque<Job>,
    /// The newest frame that the window has taken.
    taken: u64,
    stop: bool,
}

/// What the thread has done.
#[derive(Clone, Default)]
pub struct Outbox {
    /// The newest picture.
    pub frame: Option<Arc<Frames>>,
    /// Its number, from 1.
    pub serial: u64,
    /// Time from one picture to the next.
    pub frame_time: Duration,
    /// Whether the picture is good enough and nothing is computed.
    pub resting: bool,
    /// What takes long just now.
    pub busy: Option<String>,
}

struct Shared {
    inbox: Mutex<Inbox>,
    bell: Condvar,
    outbox: Mutex<Outbox>,
    news: Mutex<Vec<News>>,
    wake: Box<dyn Fn() + Send + Sync>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The window's end of the thread.
pub struct Worker {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl Worker {
    /// Starts the thread; it calls `wake` whenever there is something new.
    pub fn start(wake: impl Fn() + Send + Sync + 'static) -> Self {
        let shared = Arc::new(Shared {
            inbox: Mutex::default(),
            bell: Condvar::new(),
            outbox: Mutex::default(),
            news: Mutex::default(),
            wake: Box::new(wake),
        });
        let theirs = Arc::clone(&shared);
        let thread = std::thread::Builder::new().name("frames".to_owned()).spawn(move || Thread::new(theirs).run());
        Self { shared, thread: thread.ok() }
    }

    /// Whether it could be started, and has not died.
    pub fn is_alive(&self) -> bool {
        self.thread.as_ref().is_some_and(|thread| !thread.is_finished())
    }

    /// Has something done.
    pub fn send(&self, job: Job) {
        lock(&self.shared.inbox).jobs.push_back(job);
        self.shared.bell.notify_one();
    }

    /// Says what to show, and that the window has all pictures up to number `taken`.
    pub fn want(&self, want: &Want, taken: u64) {
        let mut inbox = lock(&self.shared.inbox);
        if inbox.taken != taken || inbox.want.as_ref() != Some(want) {
            if inbox.want.as_ref() != Some(want) {
                lock(&self.shared.outbox).resting = false;
            }
            inbox.want = Some(want.clone());
            inbox.taken = taken;
            self.shared.bell.notify_one();
        }
    }

    /// The state of the thread.
    pub fn outbox(&self) -> Outbox {
        lock(&self.shared.outbox).clone()
    }

    /// What has happened since the last call.
    pub fn news(&self) -> Vec<News> {
        std::mem::take(&mut *lock(&self.shared.news))
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        lock(&self.shared.inbox).stop = true;
        self.shared.bell.notify_one();
        if let Some(thread) = self.thread.take() {
            // It has said on stderr what it died of.
            let _ = thread.join();
        }
    }
}

/// The thread's own state.
struct Thread {
    shared: Arc<Shared>,
    engine: Option<Engine>,
    gpu: Option<Gpu>,
    /// What the last frame was of; no other frame of the same once it rests or has failed.
    done: Option<Want>,
    failed_gpu: bool,
    serial: u64,
    last: Instant,
    recording: Option<(PathBuf, u32)>,
}

impl Thread {
    fn new(shared: Arc<Shared>) -> Self {
        Self {
            shared,
            engine: None,
            gpu: None,
            done: None,
            failed_gpu: false,
            serial: 0,
            last: Instant::now(),
            recording: None,
        }
    }

    fn run(&mut self) {
        while let Some((want, jobs)) = self.wait() {
            for job in jobs {
                self.work(job, want.as_ref());
                (self.shared.wake)();
            }
            if let Some(want) = want.filter(|want| self.is_due(want)) {
                self.frame(&want);
                (self.shared.wake)();
            }
        }
    }

    /// Whether a frame of `want` is worth computing.
    fn is_due(&self, want: &Want) -> bool {
        self.engine.is_some() && !self.failed_gpu && self.done.as_ref() != Some(want)
    }

    /// Blocks until there is something to do; nothing at the end.
    fn wait(&self) -> Option<(Option<Want>, VecDeque<Job>)> {
        let mut inbox = lock(&self.shared.inbox);
        loop {
            if inbox.stop {
                return None;
            }
            // No picture is computed before the window has shown the last one.
            let due = inbox.taken >= self.serial && inbox.want.as_ref().is_some_and(|want| self.is_due(want));
            if due || !inbox.jobs.is_empty() {
                return Some((inbox.want.clone(), std::mem::take(&mut inbox.jobs)));
            }
            inbox = self.shared.bell.wait(inbox).unwrap_or_else(PoisonError::into_inner);
        }
    }

    fn tell(&self, news: News) {
        lock(&self.shared.news).push(news);
    }

    fn busy(&self, what: Option<String>) {
        lock(&self.shared.outbox).busy = what;
        (self.shared.wake)();
    }

    fn fail(&mut self, error: EngineError) {
        match error {
            EngineError::Gpu(error) => {
                self.failed_gpu = true;
                self.tell(News::GpuFailed(error));
            }
            error => self.tell(News::Failed(error.to_string())),
        }
    }

    fn work(&mut self, job: Job, want: Option<&Want>) {
        self.done = None;
        match job {
            Job::Open(choice) => {
                self.busy(Some(format!("opening {}", choice.scene)));
                match Engine::open(&choice, self.gpu.as_ref()) {
                    Ok((engine, warnings)) => {
                        let (facts, home) = (engine.facts().clone(), engine.home());
                        self.engine = Some(engine);
                        self.tell(News::Opened { facts, home, warnings, choice });
                    }
                    Err(error) => self.fail(error),
                }
                self.busy(None);
            }
            Job::Environment(path) => {
                self.busy(Some(format!("reading {}", path.display())));
                let read = environment::load(&path, 0.0, 1.0).map_err(EngineError::from);
                let set = read.and_then(|(map, warnings)| {
                    warnings.iter().for_each(|warning| self.tell(News::Failed(warning.to_string())));
                    self.engine.as_mut().map_or(Ok(()), |engine| engine.set_environment(map))
                });
                match set {
                    Ok(()) => self.tell_facts(),
                    Err(error) => self.fail(error),
                }
                self.busy(None);
            }
            Job::Use(gpu) => {
                self.gpu = gpu;
                self.failed_gpu = false;
                let moved = self.engine.as_mut().map_or(Ok(()), |engine| engine.move_to(self.gpu.as_ref()));
                if let Err(error) = moved {
                    self.fail(error);
                }
            }
            Job::Pick(px, purpose) => {
                let found = self.engine.as_ref().zip(want).and_then(|(engine, want)| engine.pick(want, px));
                self.tell(News::Found(found, purpose));
            }
            Job::TakeLight(picked) => {
                let Some((engine, want)) = self.engine.as_mut().zip(want) else { return };
                match engine.take_light(&picked, want) {
                    Ok(Some(light)) => {
                        self.tell(News::LightTaken(light));
                        self.tell_facts();
                    }
                    Ok(None) => {}
                    Err(error) => self.fail(error),
                }
            }
            Job::Save(path) => match self.save(&path, want) {
                Ok(()) => self.tell(News::Saved(path)),
                Err(reason) => self.tell(News::Failed(reason)),
            },
            Job::Record(folder) => self.recording = folder.map(|folder| (folder, 0)),
            Job::Measure => self.measure(want),
        }
    }

    /// Until something else is to be done.
    fn measure(&mut self, want: Option<&Want>) {
        let Some(want) = want.filter(|_| self.engine.is_some()) else { return };
        self.busy(Some("measuring what leaving work out saves".to_owned()));
        let Some(engine) = &mut self.engine else { return };
        let goes_on = || {
            let inbox = lock(&self.shared.inbox);
            !inbox.stop && inbox.jobs.is_empty()
        };
        match engine.costs(want, goes_on) {
            Ok(Some(costs)) => {
                let settings = Box::new(want.settings.clone());
                self.tell(News::Measured { settings, costs });
            }
            Ok(None) => {}
            Err(RenderError::Gpu(error)) => self.fail(EngineError::Gpu(error)),
            Err(error) => self.tell(News::Failed(error.to_string())),
        }
        self.busy(None);
    }

    fn tell_facts(&self) {
        if let Some(engine) = &self.engine {
            self.tell(News::Changed(engine.facts().clone()));
        }
    }

    fn save(&mut self, path: &std::path::Path, want: Option<&Want>) -> Result<(), String> {
        let (Some(engine), Some(want)) = (&mut self.engine, want) else {
            return Err("there is no picture yet to be saved".to_owned());
        };
        save::picture(engine, want, path).map_err(|error| error.to_string())
    }

    fn frame(&mut self, want: &Want) {
        let Some(engine) = &mut self.engine else { return };
        let facts = engine.facts().clone();
        let made = engine.frame(want);
        lock(&self.shared.outbox).busy = engine.is_compiling().then(|| "compiling passes".to_owned());
        if *engine.facts() != facts {
            self.tell_facts();
        }
        match made {
            Ok(Some(frames)) => {
                let now = Instant::now();
                self.serial += 1;
                let mut outbox = lock(&self.shared.outbox);
                outbox.frame_time = now - self.last;
                self.last = now;
                outbox.frame = Some(Arc::new(frames));
                outbox.serial = self.serial;
                outbox.resting = false;
                drop(outbox);
                self.done = None;
                self.record(want);
            }
            Ok(None) => {
                lock(&self.shared.outbox).resting = true;
                self.done = Some(want.clone());
            }
            Err(error) => {
                self.done = Some(want.clone());
                self.fail(error);
            }
        }
    }

    fn record(&mut self, want: &Want) {
        let Some((folder, number)) = self.recording.take() else { return };
        let path = folder.join(format!("frame_{number:05}.png"));
        match std::fs::create_dir_all(&folder).map_err(|e| format!("{e}: {}", folder.display())) {
            Ok(()) => match self.save(&path, Some(want)) {
                Ok(()) => self.recording = Some((folder, number + 1)),
                Err(reason) => self.tell(News::Failed(format!("recording ends: {reason}"))),
            },
            Err(reason) => self.tell(News::Failed(format!("recording ends: {reason}"))),
        }
    }
}
