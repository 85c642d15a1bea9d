//! The binary `weir`, from its arguments to its exit code, its messages and the files that it leaves.

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use tempfile::TempDir;
use weir::exit::Exit;
use weir::output::exr;

/// A triangle that the default camera sees; `m` is its material.
const TRIANGLE: &str = "mtllib t.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n";

/// Where a command runs: a folder of its own.
struct Desk {
    folder: TempDir,
    environment: Vec<(&'static str, &'static str)>,
}

/// What a command did.
struct Run {
    code: Option<i32>,
    stdout: Vec<u8>,
    stderr: String,
}

impl Desk {
    fn new() -> Self {
        Self { folder: tempfile::tempdir().expect("a temporary folder"), environment: Vec::new() }
    }

    /// Every Vulkan driver out of reach.
    fn without_gpu(mut self) -> Self {
        self.environment = vec![("VK_DRIVER_FILES", "/nonexistent"), ("VK_ICD_FILENAMES", "/nonexistent")];
        self
    }

    fn with(self, name: &str, text: &str) -> Self {
        fs::write(self.path(name), text).expect("the folder can be written to");
        self
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Names of all files, hidden ones too, in order.
    fn files(&self) -> Vec<OsString> {
        let entries = fs::read_dir(self.folder.path()).expect("the folder can be read");
        let mut names: Vec<_> = entries.map(|entry| entry.expect("the folder can be read").file_name()).collect();
        names.sort();
        names
    }

    /// Runs `weir` with arguments that are set apart by blanks.
    fn weir(&self, arguments: &str) -> Run {
        let mut command = Command::new(env!("CARGO_BIN_EXE_weir"));
        command.args(arguments.split_whitespace()).current_dir(self.folder.path());
        command.env_remove("WEIR_LOG").envs(self.environment.iter().copied());
        let Output { status, stdout, stderr } = command.output().expect("the binary starts");
        let stderr = String::from_utf8(stderr).expect("messages are UTF-8");
        assert!(!stderr.contains("panicked"), "{arguments}: {stderr}");
        Run { code: status.code(), stdout, stderr }
    }

    /// [`Desk::weir`], a small picture on the CPU.
    fn render(&self, arguments: &str) -> Run {
        self.weir(&format!("render --backend cpu --size 32x18 {} {arguments}", samples_unless_given(arguments)))
    }

    /// The command fails with a code, says all of `words`, and leaves the folder as it was.
    fn refuses(&self, arguments: &str, exit: Exit, words: &[&str]) {
        let before = self.files();
        let run = self.weir(arguments);
        run.ends(exit);
        for word in words {
            assert!(run.stderr.contains(word), "{arguments}: no {word:?} in: {}", run.stderr);
        }
        assert!(run.stdout.is_empty(), "{arguments}: a failed command prints no result");
        assert_eq!(self.files(), before, "{arguments}");
    }

    fn picture(&self, name: &str) -> Vec<u8> {
        fs::read(self.path(name)).expect("the picture is there")
    }
}

fn samples_unless_given(arguments: &str) -> &'static str {
    if arguments.contains("--spp") || arguments.contains("--time") { "" } else { "--spp 2" }
}

impl Run {
    #[track_caller]
    fn ends(&self, exit: Exit) {
        assert_eq!(self.code, Some(i32::from(exit.code())), "{exit:?} is due; stderr: {}", self.stderr);
    }

    /// Done, with all of `words` among the warnings.
    #[track_caller]
    fn warns(&self, words: &[&str]) {
        self.ends(Exit::Ok);
        let warnings: Vec<_> = self.stderr.lines().filter(|line| line.contains("WARN")).collect();
        for word in words {
            assert!(warnings.iter().any(|line| line.contains(word)), "no warning with {word:?}: {}", self.stderr);
        }
    }

    fn text(&self) -> &str {
        std::str::from_utf8(&self.stdout).expect("results in words are UTF-8")
    }
}

/// Width and height of a PNG file.
#[track_caller]
fn png_size(bytes: &[u8]) -> (u32, u32) {
    let picture = image::load_from_memory_with_format(bytes, image::ImageFormat::Png).expect("a PNG");
    (picture.width(), picture.height())
}

/// Mean of all channels of an EXR file.
fn mean(path: &Path) -> f64 {
    let (picture, _) = exr::read(path).expect("an EXR file");
    let values = picture.rgb.as_flattened();
    values.iter().map(|&v| f64::from(v)).sum::<f64>() / values.len() as f64
}

#[test]
fn a_scene_that_is_not_there_is_no_input() {
    let desk = Desk::new();
    desk.refuses("render gone.obj --backend cpu -o p.png", Exit::NoInput, &["weir: ", "gone.obj", "help:"]);
    desk.refuses("render cornel --backend cpu -o p.png", Exit::NoInput, &["cornel:", "help:", "cornell", "rooms"]);
    desk.refuses("render . --backend cpu -o p.png", Exit::NoInput, &["help:"]);
    desk.refuses("render cornell --camera gone.json -o p.png", Exit::NoInput, &["gone.json", "help:"]);
    desk.refuses("render cornell --environment gone.hdr -o p.png", Exit::NoInput, &["gone.hdr", "help:"]);
}

#[test]
fn damaged_input_is_bad_data_with_its_line() {
    let desk = Desk::new()
        .with("line.obj", "v 0 0 0\nv 1 0 0\nv 0 1\nf 1 2 3\n")
        .with("empty.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n")
        .with("camera.json", "{\n\"origin\": [1, 2],\n}")
        .with("sky.hdr", "not a picture");
    desk.refuses("render line.obj -o p.png", Exit::BadData, &["line.obj:3: ", "help:"]);
    desk.refuses("render empty.obj -o p.png", Exit::BadData, &["empty.obj: ", "help:"]);
    desk.refuses("render cornell --camera camera.json -o p.png", Exit::BadData, &["camera.json:", "help:"]);
    desk.refuses("render cornell --environment sky.hdr -o p.png", Exit::BadData, &["sky.hdr", "help:"]);
}

#[test]
fn a_scene_that_lacks_something_warns_and_gives_a_picture() {
    let dark = Desk::new().with("t.obj", TRIANGLE).with("t.mtl", "newmtl m\nKd 0.5 0.5 0.5\n");
    dark.render("t.obj -o p.png").warns(&["nothing emits light"]);
    assert_eq!(png_size(&dark.picture("p.png")), (32, 18));

    let odd = "newmtl m\nKe nan 1 1\nnewmtl n\nKe -1 1 1\n";
    let odd = Desk::new().with("t.obj", TRIANGLE).with("t.mtl", odd);
    odd.render("t.obj -o p.png").warns(&["t.mtl:2: ", "t.mtl:4: "]);

    let bare = Desk::new().with("t.obj", TRIANGLE);
    bare.render("t.obj -o p.png").warns(&["t.obj:1: ", "t.mtl"]);
}

#[test]
fn an_output_that_cannot_be_written_is_said_before_the_scene_is_read() {
    let desk = Desk::new();
    fs::create_dir(desk.path("folder.png")).expect("the folder can be written to");
    // The scene does not exist either, but that comes later.
    desk.refuses("render gone.obj -o no/p.png", Exit::CannotCreate, &["directory `no` does not exist; create it"]);
    desk.refuses("render gone.obj -o folder.png", Exit::CannotCreate, &["is a directory; append a file name"]);
    desk.refuses("render gone.obj -o p.jpg", Exit::Usage, &["pictures are .png or .exr, not p.jpg"]);
    if cfg!(target_os = "linux") {
        desk.refuses("render gone.obj -o /proc/p.png", Exit::CannotCreate, &["no file can be created there"]);
    }
    let desk = desk.with("file", "");
    desk.refuses("export cornell file/out", Exit::CannotCreate, &["cannot make the directory", "file/out"]);
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_an_io_error() {
    let run = Desk::new().render("cornell -o /dev/full");
    run.ends(Exit::Io);
    assert!(run.stderr.contains("no space left") && run.stderr.contains("/dev/full"), "{}", run.stderr);
}

#[test]
fn a_dash_writes_nothing_but_a_png_to_stdout() {
    let desk = Desk::new();
    let run = desk.render("cornell -o -");
    run.ends(Exit::Ok);
    assert_eq!(png_size(&run.stdout), (32, 18));
    assert!(desk.files().is_empty(), "{:?}", desk.files());
}

#[test]
fn the_path_of_a_picture_goes_to_stdout() {
    let desk = Desk::new();
    let run = desk.render("cornell -o p.png");
    run.ends(Exit::Ok);
    assert!(run.text().trim_end().ends_with("p.png") && Path::new(run.text().trim_end()).is_absolute());
    assert_eq!(desk.files(), ["p.png"]);
}

#[test]
fn a_wrong_argument_is_a_usage_error() {
    let desk = Desk::new();
    for (arguments, words) in [
        ("--set candidates=8", "there is no knob `candidates`; there are `preset`, `candidates.count`"),
        ("--set candidates.count=0", "`candidates.count` takes 1 to 4096, not `0`"),
        ("--set candidates.count", "`candidates.count` is not of the form key=value"),
        ("--size 0x9", "WIDTHxHEIGHT"),
        ("--size 32", "WIDTHxHEIGHT"),
        ("--size 99999x9", "WIDTHxHEIGHT"),
        ("--spp 0", "--spp"),
        ("--spp 2 --time 1", "--time"),
        ("--time 0", "--time takes a number of seconds above 0"),
        ("--time NaN", "--time takes a number of seconds above 0"),
        ("--exposure NaN", "--exposure takes a number above 0, not NaN"),
        ("--exposure 0", "--exposure takes a number above 0, not 0"),
        ("--integrator magic", "restir, restir-temporal, ris, reference"),
        ("--nonsense", "--nonsense"),
    ] {
        desk.refuses(&format!("render cornell -o p.png {arguments}"), Exit::Usage, &[words]);
    }
    desk.refuses("render", Exit::Usage, &["<SCENE>"]);
}

#[test]
fn without_a_gpu_auto_warns_and_the_others_are_unavailable() {
    let desk = Desk::new().without_gpu();
    desk.weir("render cornell --size 32x18 --spp 1 -o p.png").warns(&["no GPU answers", "rendering on the CPU"]);
    assert_eq!(png_size(&desk.picture("p.png")), (32, 18));
    let remedy = &["no GPU answers; install a Vulkan driver"];
    desk.refuses("render cornell --size 32x18 --spp 1 -o q.png --backend gpu", Exit::Unavailable, remedy);
    desk.refuses("check cornell --size 32x18", Exit::Unavailable, remedy);
    let run = desk.weir("info");
    run.ends(Exit::Ok);
    assert!(run.text().contains("GPU: none answers"), "{}", run.text());
}

#[test]
fn the_seed_decides_the_picture_and_the_threads_do_not() {
    let desk = Desk::new();
    for threads in [1, 2, 16] {
        desk.render(&format!("cornell --seed 3 --threads {threads} -o {threads}.png")).ends(Exit::Ok);
    }
    desk.render("cornell --seed 4 -o other.png").ends(Exit::Ok);
    assert_eq!(desk.picture("1.png"), desk.picture("2.png"));
    assert_eq!(desk.picture("1.png"), desk.picture("16.png"));
    assert_ne!(desk.picture("1.png"), desk.picture("other.png"));
}

#[test]
fn pictures_of_odd_sizes_work() {
    let desk = Desk::new();
    for (width, height) in [(1, 1), (7, 5), (1, 64)] {
        let run = desk.weir(&format!("render cornell --backend cpu --spp 2 --size {width}x{height} -o p.png"));
        run.ends(Exit::Ok);
        assert_eq!(png_size(&desk.picture("p.png")), (width, height));
    }
}

#[test]
fn a_limit_of_time_ends_the_picture() {
    let desk = Desk::new();
    desk.render("cornell --time 0.05 -o p.png").ends(Exit::Ok);
    assert_eq!(png_size(&desk.picture("p.png")), (32, 18));
}

/// What there is by then is saved, whole.
#[cfg(unix)]
#[test]
fn an_interrupted_picture_is_saved() {
    for (signal, exit) in [("-INT", Exit::Interrupted), ("-TERM", Exit::Terminated)] {
        let desk = Desk::new();
        let mut command = Command::new(env!("CARGO_BIN_EXE_weir"));
        command.args("render cornell --backend cpu --size 32x18 --time 600 -o p.png".split_whitespace());
        let mut child = command.current_dir(desk.folder.path()).spawn().expect("the binary starts");
        std::thread::sleep(std::time::Duration::from_secs(3));
        let sent = Command::new("kill").args([signal, &child.id().to_string()]).status().expect("there is `kill`");
        assert!(sent.success());
        let status = child.wait().expect("it ends");
        assert_eq!(status.code(), Some(i32::from(exit.code())));
        assert_eq!(png_size(&desk.picture("p.png")), (32, 18));
    }
}

#[test]
fn an_exr_file_has_layers() {
    let desk = Desk::new();
    desk.render("cornell -o p.exr").ends(Exit::Ok);
    let (picture, channels) = exr::read(&desk.path("p.exr")).expect("an EXR file");
    assert_eq!((picture.width, picture.height), (32, 18));
    let names: Vec<_> = channels.iter().map(|channel| channel.name.as_str()).collect();
    for name in ["Z", "N.X", "P.X", "Albedo.R", "Variance.R", "samples", "light.id"] {
        assert!(names.contains(&name), "no {name} among {names:?}");
    }
}

#[test]
fn the_reference_agrees_with_the_passes_on_the_mean() {
    let desk = Desk::new();
    // The edge of the light in view is the noisiest thing there: many samples.
    desk.render("cornell --spp 1024 --set still.rounds=1 -o passes.exr").ends(Exit::Ok);
    desk.render("cornell --spp 1024 --integrator reference -o reference.exr").ends(Exit::Ok);
    let (passes, reference) = (mean(&desk.path("passes.exr")), mean(&desk.path("reference.exr")));
    assert!(passes > 0.0 && (passes / reference - 1.0).abs() < 0.03, "{passes} and {reference}");
}

#[test]
fn an_exported_scene_renders_as_the_built_in_one() {
    let desk = Desk::new();
    let run = desk.weir("export cornell out");
    run.ends(Exit::Ok);
    assert!(run.text().contains("cornell.obj") && run.text().contains("triangles"), "{}", run.text());
    desk.render("cornell --spp 64 -o ours.exr").ends(Exit::Ok);
    desk.render("out/cornell.obj --camera out/cornell-camera.json --spp 64 -o theirs.exr").ends(Exit::Ok);
    let (ours, theirs) = (mean(&desk.path("ours.exr")), mean(&desk.path("theirs.exr")));
    assert!(ours > 0.0 && (theirs / ours - 1.0).abs() < 0.02, "{ours} and {theirs}");
}

#[test]
fn an_export_has_the_camera_that_was_asked_for_or_one_that_sees_the_scene() {
    let camera = r#"{"origin": [0, 0, 7], "target": [0, 0, 0], "up": [0, 1, 0], "vfov_deg": 31}"#;
    let desk = Desk::new().with("t.obj", TRIANGLE).with("c.json", camera);
    desk.weir("export t.obj asked --camera c.json").ends(Exit::Ok);
    let asked = fs::read_to_string(desk.path("asked/t-camera.json")).expect("a camera");
    assert!(asked.contains("7.0") && asked.contains("31.0"), "{asked}");
    desk.weir("export t.obj framed").ends(Exit::Ok);
    desk.render("framed/t.obj --camera framed/t-camera.json -o p.png").ends(Exit::Ok);
}

#[test]
fn commands_that_inform_print_to_stdout() {
    let desk = Desk::new();
    for (arguments, words) in [
        ("scenes", ["cornell", "rooms"]),
        ("info", ["CPU: ", "GPU"]),
        ("graph cornell", ["primary", "candidates"]),
        ("graph cornell --dot", ["digraph", "primary"]),
        ("graph cornell --costs --turns 1 --size 16x9 --backend cpu", ["all off", "textures alone"]),
        ("--help", ["candidates.count", "path.length"]),
        ("render --help", ["candidates.source", "scene.time"]),
    ] {
        let run = desk.weir(arguments);
        run.ends(Exit::Ok);
        assert!(words.iter().all(|word| run.text().contains(word)), "{arguments}: {}", run.text());
    }
    assert!(desk.files().is_empty(), "{:?}", desk.files());
}

#[test]
fn a_pixel_of_a_still_is_what_the_picture_has_there() {
    let desk = Desk::new();
    desk.render("cornell --seed 5 --spp 1 -o a.exr").ends(Exit::Ok);
    let (picture, _) = exr::read(&desk.path("a.exr")).expect("a picture");
    let expected = picture.rgb[12 * 32 + 20].map(|x| format!("{x:?}")).join(" ");
    let run = desk.weir("pixel 20,12 cornell --size 32x18 --seed 5 --integrator restir");
    run.ends(Exit::Ok);
    let text = String::from_utf8(run.stdout).expect("text");
    let moments = text.lines().find(|line| line.trim_start().starts_with("moments:")).expect("the last of the passes");
    assert!(moments.contains(&expected), "{moments}, not {expected}");
    // In real time, the frames before it count.
    let real_time = |history: &str| {
        let run = desk.weir(&format!(
            "pixel 20,12 cornell --size 32x18 --frame 9 --history {history} --set skip.closed_form=off"
        ));
        run.ends(Exit::Ok);
        run.stdout
    };
    assert_ne!(real_time("0"), real_time("4"));
    assert_eq!(real_time("4"), real_time("4"));
    desk.refuses("pixel 32,0 cornell --size 32x18", Exit::Usage, &["no pixel 32,0 in 32x18"]);
    desk.refuses("pixel twelve cornell", Exit::Usage, &["a pixel is X,Y"]);
}

#[test]
fn lights_come_from_a_file_beside_the_scene_or_from_one_that_is_named_and_are_exported() {
    let light =
        |kind: &str, more: &str| format!(r#"{{"lights": [{{"type": "{kind}", "position": [0, 0, 2], {more}}}]}}"#);
    let desk = Desk::new()
        .with("t.obj", TRIANGLE)
        .with("t.lights.json", &light("point", r#""intensity": 9"#))
        .with("other.json", &light("sphere", r#""radius": 0.1, "radiance": 1"#))
        .with("broken.json", &light("sphere", r#""radius": 0, "radiance": 1"#));
    let mean_of = |arguments: &str| {
        desk.render(&format!("{arguments} -o p.exr")).ends(Exit::Ok);
        mean(&desk.path("p.exr"))
    };
    let (beside, named) = (mean_of("t.obj"), mean_of("t.obj --lights other.json"));
    assert!(beside > 100.0 * named && named > 0.0, "{beside} {named}");
    desk.weir("export t.obj out").ends(Exit::Ok);
    assert_eq!(mean_of("out/t.obj"), beside);
    let exported = fs::read_to_string(desk.path("out/t.lights.json")).expect("lights");
    assert!(exported.contains("\"point\"") && exported.contains("\"intensity\""), "{exported}");
    let words = ["broken.json: light 1: `radius` is 0, not in 1e-9..=1e9", "help:"];
    desk.refuses("render t.obj --lights broken.json --backend cpu -o p.png", Exit::BadData, &words);
    desk.refuses("render t.obj --lights gone.json --backend cpu -o p.png", Exit::NoInput, &["gone.json"]);
    fs::write(desk.path("t.lights.json"), "[").expect("the folder can be written to");
    desk.refuses("render t.obj --backend cpu -o p.png", Exit::BadData, &["t.lights.json:1: not lights"]);
}
