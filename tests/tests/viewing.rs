//! The viewer's frames on a GPU, without a window.

use weir::{
    settings::Settings,
    technique::Technique,
    view::{
        engine::{Engine, Frames},
        want::Want,
    },
};
use weir_tests::{own_gpu_or_skip, scenes::cornell};

/// More frames than compiling can last.
const MOST: u32 = 100_000;

fn want(engine: &Engine, knobs: &[&str]) -> Want {
    let mut settings = Settings::default();
    knobs.iter().for_each(|knob| settings.apply(knob).expect("a knob"));
    Want { settings, ..Want::plain(engine.home(), [24, 18]) }
}

fn frame(engine: &mut Engine, want: &Want) -> Frames {
    engine.frame(want).expect("a frame").expect("not at rest")
}

fn passes(frames: &Frames) -> Vec<&'static str> {
    frames.schedule.steps.iter().map(|step| step.pass).collect()
}

/// Frames by the old settings go on while the passes of the new ones are compiled, and frames in real time while those of a
/// still are.
#[test]
fn frames_go_on_while_the_passes_of_other_frames_are_compiled() {
    let Some(gpu) = own_gpu_or_skip("frames_go_on_while_the_passes_of_other_frames_are_compiled") else { return };
    let mut engine = Engine::new(cornell(), Some(&gpu)).expect("it fits");
    let before = want(&engine, &["rays=speed", "candidates.bsdf=0"]);
    let first = passes(&frame(&mut engine, &before));
    assert!(!engine.is_compiling(), "the first frame waits for its passes");
    assert_eq!(passes(&frame(&mut engine, &before)), first);

    let after = want(&engine, &["rays=speed", "candidates.bsdf=0", "spatial.rounds=1"]);
    assert_eq!(passes(&frame(&mut engine, &after)), first, "the others are not there yet");
    assert!(engine.is_compiling());
    let goes_over = (0..MOST).find(|_| passes(&frame(&mut engine, &after)) != first);
    assert!(goes_over.is_some());
    let second = passes(&frame(&mut engine, &after));
    assert!(second.contains(&"spatial") && !first.contains(&"spatial"), "{second:?}");
    // The thread may still be about to keep what it has compiled for the next run.
    assert!((0..MOST).any(|_| {
        frame(&mut engine, &after);
        !engine.is_compiling()
    }));
    // What was compiled is there at once.
    assert_eq!(passes(&frame(&mut engine, &before)), first);
    assert_eq!(passes(&frame(&mut engine, &after)), second);

    let stands = Want { accumulate: true, settings: want(&engine, &["rays=quality"]).settings, ..after };
    assert_eq!(passes(&frame(&mut engine, &stands)), second);
    let mut in_real_time = 0;
    let still = (0..MOST).map(|_| frame(&mut engine, &stands)).find(|frames| {
        in_real_time += u32::from(frames.technique == Technique::RealTime);
        frames.technique == Technique::Still
    });
    assert_eq!(still.map(|frames| frames.samples), Some(1));
    assert!(in_real_time > 1, "frames in real time go on: {in_real_time}");
    assert_eq!(frame(&mut engine, &stands).samples, 2);
}

/// A device that is lost while a thread compiles for it is an error like any other, and the host can go on.
#[test]
fn a_device_that_is_lost_while_it_compiles_is_an_error() {
    let Some(gpu) = own_gpu_or_skip("a_device_that_is_lost_while_it_compiles_is_an_error") else { return };
    let mut engine = Engine::new(cornell(), Some(&gpu)).expect("it fits");
    let before = want(&engine, &["rays=speed", "candidates.bsdf=0"]);
    frame(&mut engine, &before);
    let after = want(&engine, &["rays=quality", "spatial.rounds=2"]);
    frame(&mut engine, &after);
    assert!(engine.is_compiling());
    gpu.lose();
    let error = (0..MOST).find_map(|_| engine.frame(&after).err()).expect("it is lost");
    assert!(error.to_string().contains("lost"), "{error}");
    engine.move_to(None).expect("the host goes on");
    assert!(!engine.is_compiling() && passes(&frame(&mut engine, &after)).contains(&"spatial"));
}
