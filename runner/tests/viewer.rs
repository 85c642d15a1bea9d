//! The viewer for real: its binary under a virtual display, driven by scripts, its window's contents looked at.

use std::{
    fs,
    io::Write as _,
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    sync::{Mutex, MutexGuard, PoisonError},
    thread::sleep,
    time::{Duration, Instant},
};

use image::RgbaImage;
use tempfile::TempDir;

/// A virtual display of its own; one test at a time, because each fills the machine.
struct Display {
    server: Child,
    name: String,
    folder: TempDir,
    _turn: MutexGuard<'static, ()>,
}

static TURN: Mutex<()> = Mutex::new(());

impl Display {
    /// Starts the server; without one, says so and returns nothing. With REQUIRE_GPU=1 a missing server fails.
    fn start(test: &str) -> Option<Self> {
        let turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
        let number = (90..200).find(|n| !Path::new(&format!("/tmp/.X{n}-lock")).exists()).expect("a free display");
        let name = format!(":{number}");
        let arguments = [name.as_str(), "-screen", "0", "1400x1000x24", "-nolisten", "tcp"];
        let server = Command::new("Xvfb").args(arguments).stdout(Stdio::null()).stderr(Stdio::null()).spawn();
        let Ok(server) = server else {
            let required = std::env::var("REQUIRE_GPU").is_ok_and(|value| value == "1");
            assert!(!required, "{test}: there is no Xvfb; install the package xvfb");
            // Past the capture of the test harness, which shows nothing of tests that pass.
            let _ = writeln!(std::io::stderr(), "SKIPPED: {test}: there is no Xvfb");
            return None;
        };
        let socket = PathBuf::from(format!("/tmp/.X11-unix/X{number}"));
        let start = Instant::now();
        while !socket.exists() && start.elapsed() < Duration::from_secs(20) {
            sleep(Duration::from_millis(50));
        }
        Some(Self { server, name, folder: tempfile::tempdir().expect("a folder"), _turn: turn })
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_weir"));
        command.args(arguments).current_dir(self.folder.path());
        command.env("DISPLAY", &self.name).env_remove("WAYLAND_DISPLAY").env_remove("WEIR_LOG");
        command.env("XDG_CONFIG_HOME", self.path("config")).env("XDG_CACHE_HOME", self.path("cache"));
        command.env("XDG_PICTURES_DIR", self.path("pictures"));
        command
    }

    /// Runs a script on a scene to its end; returns what went to stderr.
    fn run(&self, scene: &str, script: &str, more: &[&str], variables: &[(&str, &str)]) -> String {
        let file = self.path("script");
        fs::write(&file, script).expect("writable");
        let file = file.to_str().expect("a plain path");
        let size = ["view", scene, "--size", "1000x560", "--scale", "0.25", "--script", file];
        let mut command = self.command(&[&size, more].concat());
        command.envs(variables.iter().copied()).stdout(Stdio::null()).stderr(Stdio::piped());
        let mut child = command.spawn().expect("the binary starts");
        let start = Instant::now();
        while child.try_wait().expect("a child").is_none() {
            if start.elapsed() > Duration::from_secs(300) {
                let _ = child.kill();
                panic!("the script does not end:\n{script}");
            }
            sleep(Duration::from_millis(20));
        }
        let output = child.wait_with_output().expect("a child");
        let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{:?}:\n{script}\n{stderr}", output.status.code());
        assert!(!stderr.contains("panicked"), "{stderr}");
        stderr
    }

    fn shot(&self, name: &str) -> RgbaImage {
        image::open(self.path(name)).expect("a picture of the window").into_rgba8()
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

/// The part of a window in which the picture is when panels are hidden, without the corner with its label.
fn picture(window: &RgbaImage) -> Vec<[u8; 3]> {
    let (width, height) = window.dimensions();
    let inside = |x: &u32, y: &u32| *x > width / 10 && *y > height / 5 && *y < height * 9 / 10;
    let all = window.enumerate_pixels().filter(|(x, y, _)| inside(x, y));
    all.map(|(_, _, pixel)| [pixel.0[0], pixel.0[1], pixel.0[2]]).collect()
}

/// Mean absolute difference of two pictures, in steps of 8 bits.
fn difference(a: &[[u8; 3]], b: &[[u8; 3]]) -> f64 {
    assert_eq!(a.len(), b.len());
    let of = |(a, b): (&[u8; 3], &[u8; 3])| (0..3).map(|c| f64::from(a[c].abs_diff(b[c]))).sum::<f64>() / 3.0;
    a.iter().zip(b).map(of).sum::<f64>() / a.len() as f64
}

/// Whether there is something in it: bright and dark pixels, and more than a few colours.
fn has_content(pixels: &[[u8; 3]]) -> bool {
    let colors: std::collections::HashSet<_> = pixels.iter().map(|p| p.map(|c| c / 8)).collect();
    let (low, high) = pixels.iter().fold((255, 0), |(low, high), p| (low.min(p[1]), high.max(p[1])));
    colors.len() > 50 && high > low.saturating_add(60)
}

#[test]
fn the_window_shows_the_picture_its_panels_and_what_keys_and_drags_change() {
    let Some(display) = Display::start("the_window_shows_the_picture") else { return };
    let script = "wait 8\nscreenshot panels.png\nkey F2\nwait 6\nscreenshot plain.png\nwait 6\nscreenshot again.png\n\
                  drag left 120 30\nwait 8\nscreenshot turned.png\nkey R\nwait 8\nscreenshot back.png\n\
                  hold Shift+W 8\nwait 4\nscreenshot flown.png\nkey R\nkey N\nwait 4\nscreenshot normals.png\n\
                  key M\nkey F1\nwait 3\nscreenshot help.png\nquit\n";
    display.run("cornell", script, &["--backend", "cpu"], &[]);
    let [plain, again, turned, back, flown, normals, help] =
        ["plain", "again", "turned", "back", "flown", "normals", "help"]
            .map(|n| picture(&display.shot(&format!("{n}.png"))));
    assert!(has_content(&plain), "the picture is blank");
    let noise = difference(&plain, &again);
    assert!(noise < 12.0, "what stands still changes by {noise}");
    for (name, other) in [("turned", &turned), ("flown", &flown), ("normals", &normals), ("help", &help)] {
        let change = difference(&plain, other);
        assert!(change > 3.0 * noise + 3.0, "{name}: changes by {change}, noise is {noise}");
    }
    assert!(difference(&plain, &back) < 12.0, "R goes back to the camera of the scene");
    // Panels have text: many light pixels at the left edge, where the picture has none without them.
    let left = |image: &RgbaImage| image.enumerate_pixels().filter(|(x, _, p)| *x < 120 && p.0[0] > 150).count();
    let (with, without) = (left(&display.shot("panels.png")), left(&display.shot("again.png")));
    assert!(with != without, "the panels are not there");
}

#[test]
fn resizing_minimising_and_losing_the_surface_or_the_gpu_are_survived() {
    let Some(display) = Display::start("resizing_minimising_and_losing") else { return };
    let mut script = String::from("wait 3\nkey F2\n");
    for i in 0..20 {
        script += &format!("resize {} {}\nwait 1\n", 300 + 37 * (i * 7 % 13), 200 + 23 * (i * 5 % 11));
    }
    script += "minimize\nrestore\nresize 1000 560\nwait 4\nscreenshot resized.png\nlose-surface\nwait 2\nlose\nwait 4\n\
               screenshot recovered.png\nlose\nwait 2\nlose\nwait 4\nscreenshot host.png\nquit\n";
    let stderr = display.run("cornell", &script, &["--backend", "cpu"], &[]);
    let resized = display.shot("resized.png");
    assert_eq!(resized.dimensions(), (1000, 560));
    assert!(has_content(&picture(&resized)));
    for name in ["recovered.png", "host.png"] {
        assert!(has_content(&picture(&display.shot(name))), "{name} is blank");
    }
    assert!(stderr.contains("the GPU was lost"), "{stderr}");
}

#[test]
fn a_broken_file_is_a_message_and_the_program_goes_on() {
    let Some(display) = Display::start("a_broken_file_is_a_message") else { return };
    fs::write(display.path("broken.obj"), "v 0 0 0\nf 1 2 3\n").expect("writable");
    fs::write(display.path("song.mp3"), "la").expect("writable");
    let script = "wait 4\nkey F2\nwait 4\nscreenshot before.png\ndrop broken.obj\nmessage broken.obj\n\
                  screenshot after.png\ndrop song.mp3\nmessage song.mp3\nquit\n";
    let stderr = display.run("cornell", script, &["--backend", "cpu"], &[]);
    assert!(stderr.contains("broken.obj:2") && stderr.contains("song.mp3"), "{stderr}");
    // The message is a red box, below others that may still be there; what is in the middle of the picture is grey.
    let red = |image: &RgbaImage| {
        let is_red = |p: &image::Rgba<u8>| p.0[0] > 90 && p.0[0] < 130 && p.0[1] < 45 && p.0[2] < 45;
        image.enumerate_pixels().filter(|(x, _, p)| (350..650).contains(x) && is_red(p)).count()
    };
    let (before, after) = (red(&display.shot("before.png")), red(&display.shot("after.png")));
    assert!(before < 100 && after > 5000, "{before} {after}");
    assert!(has_content(&picture(&display.shot("after.png"))), "the scene before is still shown");
}

#[test]
fn without_a_file_dialog_the_window_says_so() {
    let Some(display) = Display::start("without_a_file_dialog") else { return };
    let none = [("DBUS_SESSION_BUS_ADDRESS", "unix:path=/nonexistent"), ("PATH", "/nonexistent")];
    let script = "wait 4\nkey Ctrl+O\nmessage no file dialog\nscreenshot after.png\nquit\n";
    let stderr = display.run("cornell", script, &["--backend", "cpu"], &none);
    assert!(stderr.contains("no file dialog"), "{stderr}");
    assert!(has_content(&picture(&display.shot("after.png"))), "the program goes on");
}

#[test]
fn without_any_vulkan_driver_the_host_draws_the_same_window() {
    let Some(display) = Display::start("without_any_vulkan_driver") else { return };
    let script = "wait 6\nscreenshot panels.png\nkey F2\nwait 8\nscreenshot plain.png\nquit\n";
    let none = [("VK_DRIVER_FILES", "/nonexistent"), ("VK_ICD_FILENAMES", "/nonexistent")];
    let stderr = display.run("cornell", script, &[], &none);
    assert!(stderr.contains("no GPU answers") && stderr.contains("The CPU draws the window"), "{stderr}");
    let host = display.shot("plain.png");
    assert!(has_content(&picture(&host)));
    display.run("cornell", script, &["--backend", "cpu"], &[]);
    let gpu = display.shot("plain.png");
    let apart = difference(&picture(&host), &picture(&gpu));
    assert!(apart < 12.0, "the same picture, but for noise: {apart}");
}

#[test]
fn frames_and_recordings_end_by_themselves() {
    let Some(display) = Display::start("frames_and_recordings_end") else { return };
    let arguments = ["view", "cornell", "--size", "640x360", "--scale", "0.25", "--backend", "cpu", "--frames", "5"];
    let files = ["--screenshot", "window.png", "--record", "frames"];
    let output = display.command(&[&arguments[..], &files].concat()).output().expect("the binary starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(display.shot("window.png").dimensions(), (640, 360));
    let recorded = fs::read_dir(display.path("frames")).expect("a folder").count();
    assert!(recorded >= 5, "{recorded} pictures");
}

#[test]
fn a_picture_at_rest_takes_no_time_of_the_processor() {
    let Some(display) = Display::start("a_picture_at_rest") else { return };
    let settings = display.path("config/weir");
    fs::create_dir_all(&settings).expect("creatable");
    fs::write(settings.join("viewer.toml"), "goal_percent = 20.0\n").expect("writable");
    let arguments = ["view", "cornell", "--size", "400x300", "--scale", "0.25", "--backend", "cpu"];
    let mut child = display.command(&arguments).stderr(Stdio::null()).spawn().expect("the binary starts");
    // User and system time of the process, in ticks of a hundredth of a second.
    let ticks = |pid: u32| -> u64 {
        let stat = fs::read_to_string(format!("/proc/{pid}/stat")).expect("a process");
        let fields: Vec<&str> = stat.rsplit(')').next().expect("fields").split_whitespace().collect();
        fields[11].parse::<u64>().expect("a number") + fields[12].parse::<u64>().expect("a number")
    };
    let start = Instant::now();
    let mut quiet = false;
    let mut last = ticks(child.id());
    while !quiet && start.elapsed() < Duration::from_secs(120) {
        sleep(Duration::from_secs(4));
        let now = ticks(child.id());
        // Messages that go away by themselves may wake it once.
        quiet = start.elapsed() > Duration::from_secs(12) && now - last <= 2;
        last = now;
    }
    let _ = child.kill();
    let _ = child.wait();
    assert!(quiet, "the viewer never rests");
}
