//! Margins of error, budgets, `compare` and `bench`, by the binary.

use std::{fs, path::Path, process::Command};

use tempfile::TempDir;
use weir::{
    bench::results::Results,
    exit::Exit,
    output::{Destination, Layers, Picture, exr},
};

/// A folder, and what a command did in it.
struct Desk(TempDir);

struct Run {
    code: Option<i32>,
    stdout: String,
    stderr: String,
}

impl Desk {
    fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary folder"))
    }

    fn weir(&self, arguments: &str) -> Run {
        let mut command = Command::new(env!("CARGO_BIN_EXE_weir"));
        command.args(arguments.split_whitespace()).current_dir(self.0.path()).env_remove("WEIR_LOG");
        command.env("XDG_CACHE_HOME", self.0.path().join("cache")).env("HOME", self.0.path());
        let output = command.output().expect("the binary starts");
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("UTF-8");
        let run = Run { code: output.status.code(), stdout: text(output.stdout), stderr: text(output.stderr) };
        assert!(!run.stderr.contains("panicked"), "{arguments}: {}", run.stderr);
        run
    }

    fn path(&self, name: &str) -> std::path::PathBuf {
        self.0.path().join(name)
    }

    #[track_caller]
    fn ends(&self, arguments: &str, exit: Exit, words: &[&str]) -> Run {
        let run = self.weir(arguments);
        let said = format!("{}{}", run.stdout, run.stderr);
        assert_eq!(run.code, Some(i32::from(exit.code())), "{arguments}: {said}");
        for word in words {
            assert!(said.contains(word), "{arguments}: no {word:?} in: {said}");
        }
        run
    }
}

const SMALL: &str = "render cornell --backend cpu --size 32x18";

#[test]
fn a_still_states_its_margin_and_draws_it() {
    let desk = Desk::new();
    desk.ends(
        &format!("{SMALL} --spp 8 -o a.exr --heat-map h.png"),
        Exit::Ok,
        &["mean relative error", "95 % confidence"],
    );
    let heat = image::open(desk.path("h.png")).expect("a picture");
    assert_eq!((heat.width(), heat.height()), (32, 18));
    let colors: std::collections::BTreeSet<[u8; 3]> = heat.to_rgb8().pixels().map(|p| p.0).collect();
    assert!(colors.len() > 20, "{} colours", colors.len());
    let (_, channels) = exr::read(&desk.path("a.exr")).expect("a picture");
    assert!(channels.iter().any(|c| c.name == "Variance.G"));
    assert!(!desk.weir(&format!("{SMALL} --spp 1 -o b.png")).stderr.contains("confidence"));
}

#[test]
fn an_error_is_reached_and_said() {
    let desk = Desk::new();
    let run = desk.ends(&format!("{SMALL} --error 12 -o a.png"), Exit::Ok, &["a pilot of", "mean relative error"]);
    let after = run.stderr.split("mean relative error ").nth(1).expect("the sentence");
    let error: f64 = after.split(' ').next().expect("a number").parse().expect("a number");
    assert!((8.0..13.0).contains(&error), "{error} %");
}

#[test]
fn ends_of_a_picture_exclude_each_other() {
    let desk = Desk::new();
    for pair in ["--spp 2 --time 1", "--spp 2 --error 5", "--time 1 --error 5"] {
        desk.ends(&format!("{SMALL} {pair} -o a.png"), Exit::Usage, &["cannot be used with"]);
    }
    desk.ends(&format!("{SMALL} --error 0 -o a.png"), Exit::Usage, &["--error takes per cent"]);
    let chain = format!("{SMALL} --integrator restir-temporal");
    desk.ends(&format!("{chain} --error 5 -o a.png"), Exit::Usage, &["no independent samples"]);
    desk.ends(&format!("{chain} --spp 2 --heat-map h.png -o a.png"), Exit::Usage, &["no independent samples"]);
    assert!(!desk.path("a.png").exists() && !desk.path("h.png").exists());
}

#[test]
fn a_time_is_kept_and_the_picture_written() {
    let desk = Desk::new();
    for kind in ["restir", "restir-temporal", "reference"] {
        let run =
            desk.ends(&format!("{SMALL} --integrator {kind} --time 1 -o a.png"), Exit::Ok, &["samples a pixel in "]);
        assert!(desk.path("a.png").exists());
        let text = run.stderr.split("samples a pixel in ").nth(1).expect("the time");
        let seconds: f64 = text.split(' ').next().expect("a number").parse().expect("seconds");
        // Frames of this size take a few milliseconds: a stall of the machine in the last of them may cost more.
        assert!((seconds - 1.0).abs() <= 0.03 || run.stderr.contains("off the time asked for"), "{kind}: {seconds} s");
        fs::remove_file(desk.path("a.png")).expect("it is there");
    }
    desk.ends("render rooms --backend cpu --size 320x180 --time 0.001 -o a.png", Exit::Ok, &["off the time asked for"]);
}

#[test]
fn a_budget_is_for_the_chain_and_says_how_it_went() {
    let desk = Desk::new();
    let words = ["frames within", "candidates.count="];
    desk.ends(
        &format!("{SMALL} --integrator restir-temporal --spp 30 --budget-ms 2000 --stats -o a.png"),
        Exit::Ok,
        &words,
    );
    desk.ends(
        &format!("{SMALL} --integrator restir-temporal --spp 9 --budget-ms 0.01 -o a.png"),
        Exit::Ok,
        &["takes longer than"],
    );
    desk.ends(&format!("{SMALL} --budget-ms 16 -o a.png"), Exit::Usage, &["--integrator restir-temporal"]);
    desk.ends(&format!("{SMALL} --integrator restir-temporal --budget-ms -1 -o a.png"), Exit::Usage, &[]);
    let inversion = "--integrator restir-temporal --budget-ms 16 --set reservoirs.choice=inversion";
    desk.ends(&format!("{SMALL} {inversion} -o a.png"), Exit::Usage, &["choose one of them"]);
}

fn picture(path: &Path, width: u32, values: &[f32]) {
    let rgb = values.iter().map(|v| [*v; 3]).collect();
    let picture = Picture { width, height: values.len() as u32 / width, rgb, alpha: None };
    exr::write(&Destination::File(path.to_owned()), &picture, &Layers::default(), &exr::Metadata::default())
        .expect("the folder can be written to");
}

#[test]
fn compare_ends_with_the_codes_of_idiff() {
    let desk = Desk::new();
    picture(&desk.path("a.exr"), 2, &[1.0, 2.0, 3.0, 4.0]);
    picture(&desk.path("b.exr"), 2, &[1.0, 2.0, 3.0, 4.25]);
    picture(&desk.path("c.exr"), 1, &[1.0, 2.0]);
    desk.ends("compare a.exr a.exr", Exit::Ok, &["relMSE          0e0", "verdict         same"]);
    desk.ends("compare a.exr b.exr", Exit::DIFFERS, &["largest         2.5e-1", "different"]);
    // One pixel in four differs by a quarter.
    desk.ends("compare a.exr b.exr --fail 0.3", Exit::WARNS, &["warning"]);
    desk.ends("compare a.exr b.exr --fail 0.3 --warn 0.3", Exit::Ok, &[]);
    desk.ends("compare a.exr b.exr --fail-percent 25 --warn-percent 25", Exit::Ok, &[]);
    desk.ends("compare a.exr b.exr --fail-percent 25 --warn-percent 25 --hard-fail 0.2", Exit::DIFFERS, &[]);
    desk.ends("compare a.exr b.exr --fail-percent 25 --warn-percent 25 --hard-warn 0.2", Exit::WARNS, &[]);
    desk.ends("compare a.exr c.exr", Exit::SizesDiffer, &["2x2"]);
    desk.ends("compare a.exr none.exr", Exit::FileError, &["none.exr"]);
    desk.ends("compare a.exr b.exr --fail -1", Exit::Usage, &[]);
    let run = desk.ends("compare a.exr b.exr --json --difference d.png", Exit::DIFFERS, &[]);
    let json: serde_json::Value = serde_json::from_str(&run.stdout).expect("JSON");
    assert_eq!((json["max_abs"].as_f64(), json["verdict"].as_str()), (Some(0.25), Some("different")));
    assert!(desk.path("d.png").exists());
    desk.ends("compare a.exr d.png", Exit::FileError, &["linear"]);
    desk.ends("compare d.png d.png", Exit::Ok, &[]);
}

/// A run of a few seconds.
const TINY: &str = "bench --backend cpu --scene cornell --method power still:fast chain:fast --size 32x18 --times 0.05 0.1 0.15 \
                    0.2 --seeds 3 --chain-frames 8 --reference-time 0.5 --no-extras";

fn results(desk: &Desk, file: &str) -> Results {
    serde_json::from_slice(&fs::read(desk.path(file)).expect("the results")).expect("JSON")
}

#[test]
fn a_run_leaves_results_that_can_be_compared_and_a_report() {
    let desk = Desk::new();
    let run = desk.ends(&format!("{TINY} -o one"), Exit::Ok, &["still:fast", "one/report.html"]);
    assert!(run.stderr.contains("reference"));
    let found = results(&desk, "one/results.json");
    let scene = &found.scenes[0];
    // Results are passed on: they name files, and say nothing of where the machine keeps them.
    let reference = &scene.reference.file;
    assert!(reference.starts_with("cornell-32x18-") && reference.ends_with(".exr") && !reference.contains('/'));
    assert_eq!(
        scene.methods.iter().map(|m| m.name.as_str()).collect::<Vec<_>>(),
        ["power", "still:fast", "chain:fast"]
    );
    for method in &scene.methods {
        assert_eq!(method.points.len(), if method.is_chain { 1 } else { 4 }, "{}", method.name);
        assert!(method.frame_ms.value > 0.0 && method.camera_mrays > 0.0 && method.efficiency > 0.0, "{}", method.name);
        assert!(method.bias.low < 0.05 && method.bias.high > -0.05, "{}: {:?}", method.name, method.bias);
        assert!(method.passes_ms.iter().any(|pass| pass.0 == "candidates"));
    }
    let still = &scene.methods[1];
    assert!(still.points[0].rel_mse.value > still.points[3].rel_mse.value, "more time, less error");
    assert_eq!(scene.methods[2].recovery.len(), 8);
    assert!(scene.methods[2].flicker.is_some() && (scene.methods[0].n_eff - 1.0).abs() < 1e-9 && still.n_eff > 1.0);
    assert_eq!(fs::read_to_string(desk.path("one/results.csv")).expect("the table").lines().count(), 1 + 4 + 4 + 1);
    let page = fs::read_to_string(desk.path("one/report.html")).expect("the report");
    assert!(page.contains("<svg") && page.contains("data:image/png;base64,") && !page.contains("src=\"http"));

    // The reference is kept, and used again.
    let kept = fs::read_dir(desk.path("cache/weir/references")).expect("the cache").count();
    assert_eq!(kept, 2);
    desk.ends("bench --compare one/results.json --with one/results.json", Exit::Ok, &["0 of 9"]);

    // Planted: a slower method, and a biased one.
    let mut slower = found.clone();
    slower.scenes[0].methods[1].frame_yardsticks.samples.iter_mut().for_each(|s| *s *= 5.0);
    fs::write(desk.path("slower.json"), serde_json::to_vec(&slower).expect("JSON")).expect("written");
    let worse = ["worse: cornell, still:fast: frame time", "1 of 9"];
    desk.ends("bench --compare one/results.json --with slower.json", Exit::CheckFailed, &worse);
    let mut biased = found;
    let bias = &mut biased.scenes[0].methods[0].bias;
    bias.samples.iter_mut().for_each(|s| *s -= 0.5);
    bias.value -= 0.5;
    fs::write(desk.path("biased.json"), serde_json::to_vec(&biased).expect("JSON")).expect("written");
    let worse = ["worse: cornell, power: bias", "1 of 9"];
    desk.ends("bench --compare one/results.json --with biased.json", Exit::CheckFailed, &worse);
}

#[test]
fn what_cannot_be_measured_is_refused_before_it_takes_time() {
    let desk = Desk::new();
    desk.ends("bench --method fastest", Exit::Usage, &["there is no method `fastest`", "`still:balanced`"]);
    desk.ends("bench --times 2 1", Exit::Usage, &["ascending"]);
    desk.ends("bench --scene nowhere", Exit::NoInput, &["nowhere"]);
    desk.ends("bench --compare none.json", Exit::Io, &["none.json"]);
    fs::write(desk.path("odd.json"), "{\"schema\": \"weir-bench-0\"}").expect("written");
    desk.ends("bench --compare odd.json", Exit::BadData, &["weir-bench-0"]);
    desk.ends("bench --list", Exit::Ok, &["chain:balanced"]);
    picture(&desk.path("r.exr"), 2, &[1.0, 2.0, 3.0, 4.0]);
    let with_reference = format!("{TINY} -o out --reference");
    desk.ends(&format!("{with_reference} r.exr"), Exit::BadData, &["the reference is 2x2, not 32x18"]);
    picture(&desk.path("r.exr"), 32, &[1.0; 32 * 18]);
    desk.ends(&format!("{with_reference} r.exr"), Exit::BadData, &["no channel `Variance.R`"]);
    desk.ends(&format!("{with_reference} none.exr"), Exit::NoInput, &["none.exr"]);
    fs::write(desk.path("file"), "").expect("written");
    desk.ends(&format!("{TINY} -o file/out"), Exit::CannotCreate, &["choose another with -o"]);
}
