use weir_shader::wiring::{Band, Binding, Buffers};

use super::*;

fn nothing(_: &FramePair, _: Band, _: Buffers) {}

const MAIN: &[Variant] = &[Variant { entry_point: "entry::main", run: nothing }];

const fn pass(name: &'static str, bindings: &'static [Binding]) -> Pass {
    Pass { name, extent: Extent::Pixels, features: &[], variants: MAIN, bindings }
}

const PASSES: &[Pass] = &[
    pass("make", &[Binding::read::<u32>("scene"), Binding::write::<u32>("a")]),
    pass("blur", &[Binding::read::<u32>("a"), Binding::write::<u32>("b")]),
    pass("tint", &[Binding::read::<u32>("b"), Binding::write::<u32>("c")]),
    pass("blend", &[Binding::read::<u32>("c"), Binding::read::<u32>("prev_h"), Binding::write::<u32>("h")]),
    pass("aside", &[Binding::read::<u32>("a"), Binding::write::<u32>("d")]),
    pass("narrow", &[Binding::read::<u8>("a"), Binding::write::<u32>("d")]),
    pass("itself", &[Binding::read::<u32>("a"), Binding::write::<u32>("a")]),
    pass("vandal", &[Binding::write::<u32>("scene")]),
    pass("memory", &[Binding::read::<u32>("prev_a"), Binding::write::<u32>("b")]),
    pass("stranger", &[Binding::read::<u32>("nowhere"), Binding::write::<u32>("b")]),
];

const RESOURCES: &[Resource] = &[
    Resource::new::<u32>("scene", Life::Scene),
    Resource::new::<u32>("a", Life::Transient),
    Resource::new::<u32>("b", Life::Transient),
    Resource::new::<u32>("c", Life::Transient),
    Resource::new::<u32>("d", Life::Transient),
    Resource::new::<u32>("h", Life::History),
];

fn facts() -> Facts {
    Facts {
        width: 4,
        height: 2,
        reservoirs: 3,
        candidates: 2,
        records: [5, 2],
        has: vec![Need::Lights],
        features: Vec::new(),
        traversal: Traversal::Auto,
        spared: Vec::new(),
    }
}

fn plan_of(names: &[&'static str], outputs: &[&'static str]) -> Result<Plan, GraphError> {
    let steps: Vec<_> = names.iter().map(|n| step(n)).collect();
    plan(&steps, PASSES, RESOURCES, &facts(), outputs)
}

#[test]
fn transients_share_memory_where_their_lives_do_not_meet() {
    let plan = plan_of(&["make", "blur", "tint", "blend"], &["h"]).expect("a plan");
    // a and c share a buffer; b, alive beside both, has its own.
    assert_eq!(plan.pool, [32, 32]);
    assert_eq!(plan.steps[0].slots[1].1, plan.steps[2].slots[1].1);
    assert_ne!(plan.steps[1].slots[0].1, plan.steps[1].slots[1].1);
    assert_eq!(plan.history, [History { name: "h", bytes: 32 }]);
    assert_eq!(plan.frame_bytes(), 32 + 32 + 64);
}

#[test]
fn an_output_keeps_its_memory_to_the_end_of_the_frame() {
    let plan = plan_of(&["make", "blur", "tint"], &["a", "c"]).expect("a plan");
    assert_eq!(plan.pool.len(), 3);
    assert_ne!(plan.outputs[0].1, plan.outputs[1].1);
}

#[test]
fn a_step_whose_result_nobody_reads_is_left_out_and_says_so() {
    let plan = plan_of(&["make", "aside", "blur"], &["b"]).expect("a plan");
    assert_eq!(plan.pass_names(), ["make", "blur"]);
    assert_eq!(plan.culled, [("aside", Culled::NothingReadsIt)]);
    assert!(plan.to_string().contains("aside              left out: nothing reads what it writes"));
    assert!(plan.to_dot().contains("style=dashed"));
}

#[test]
fn history_keeps_its_writer_and_what_that_reads() {
    let plan = plan_of(&["make", "blur", "tint", "blend"], &["h"]).expect("a plan");
    assert_eq!(plan.pass_names(), ["make", "blur", "tint", "blend"]);
    assert_eq!(plan.steps[3].slots[1].1, Slot::Previous(0));
    assert_eq!(plan.steps[3].slots[2].1, Slot::Current(0));
}

#[test]
fn what_no_step_looks_at_is_not_remembered() {
    let steps = [step("make"), step("blur"), step("tint"), step("blend").reads_if("prev_h", false)];
    let forgetful = plan(&steps, PASSES, RESOURCES, &facts(), &["h"]).expect("a plan");
    assert_eq!((forgetful.history.as_slice(), forgetful.steps[3].slots[1].1), (&[][..], Slot::Zero));
    assert_eq!(forgetful.zero_bytes, 4);
    assert_eq!(forgetful.frame_bytes(), 32 + 32 + 4);
    // Nor is what only it would have read.
    let steps = [step("make"), step("aside"), step("blur"), step("tint").reads_if("b", false)];
    let narrow = plan(&steps, PASSES, RESOURCES, &facts(), &["c"]).expect("a plan");
    assert_eq!(narrow.pass_names(), ["tint"]);
}

#[test]
fn what_the_scene_lacks_is_left_out_and_reads_as_zeros() {
    let steps = [step("make"), step("blur").needs(Need::Lights), step("tint")];
    let bare = Facts { has: Vec::new(), ..facts() };
    let plan = plan(&steps, PASSES, RESOURCES, &bare, &["c"]).expect("a plan");
    assert_eq!(plan.pass_names(), ["tint"]);
    assert_eq!(plan.steps[0].slots[0].1, Slot::Zero);
    assert_eq!(plan.zero_bytes, 32);
    assert_eq!(plan.culled, [("make", Culled::NothingReadsIt), ("blur", Culled::SceneHasNo(Need::Lights))]);
}

#[test]
fn hazards_are_errors_in_words() {
    let message =
        |names: &[&'static str], outputs: &[&'static str]| plan_of(names, outputs).expect_err("a hazard").to_string();
    let cases: [(&[&'static str], &[&'static str], &str); 10] = [
        (
            &["blur", "make"],
            &["b"],
            "pass `blur` reads `a`, but no earlier step writes it; for last frame's value bind `prev_a`",
        ),
        (&["make", "make"], &["a"], "pass `make` writes `a`, which `make` wrote"),
        (&["make", "narrow"], &["d"], "pass `narrow` sees `a` as 1-byte elements, the resource table says 4"),
        (&["make", "itself"], &["a"], "pass `itself` reads its own output `a`"),
        (&["vandal"], &[], "pass `vandal` writes `scene`, which belongs to the scene"),
        (&["make", "memory"], &["b"], "pass `memory` reads `prev_a`, but `a` is not history"),
        (&["stranger"], &["b"], "pass `stranger` binds `nowhere`, which is not in the resource table"),
        (&["nobody"], &[], "step `nobody` names no pass"),
        (&["make"], &["b"], "output `b` was asked for, but no step writes it"),
        (&["make", "blur"], &["h"], "output `h` was asked for"),
    ];
    for (names, outputs, expected) in cases {
        let text = message(names, outputs);
        assert!(text.contains(expected), "{text}");
    }
    let none = Facts { width: 0, ..facts() };
    let error = plan(&[step("make")], PASSES, RESOURCES, &none, &["a"]).expect_err("no pixels");
    assert!(error.to_string().contains("0x2"), "{error}");
}

#[test]
fn a_pass_that_is_repeated_writes_resources_of_its_own_each_time() {
    let steps = [step("make"), step("blur").with("b", "c"), step("blur").with("a", "c").with("b", "d").round(1)];
    let plan = plan(&steps, PASSES, RESOURCES, &facts(), &["d"]).expect("a plan");
    assert_eq!(plan.pass_names(), ["make", "blur", "blur"]);
    assert_eq!(plan.steps[2].names, ["c", "d"]);
    assert_eq!((plan.rounds(), plan.steps[2].round), (2, 1));
    // a and d share a buffer; c, alive beside both, has its own.
    assert_eq!(plan.pool, [32, 32]);
    assert!(plan.to_string().contains("(round 2)"));
    let twice = [step("make"), step("blur"), step("blur")];
    let error = super::plan(&twice, PASSES, RESOURCES, &facts(), &["b"]).expect_err("b has two writers");
    assert!(matches!(error, GraphError::TwoWriters { name: "b", .. }));
}

#[test]
fn a_step_that_the_settings_leave_out_says_why_and_reads_as_zeros() {
    let steps = [step("make"), step("blur").only_if(false, "`blur.size` is 0"), step("tint")];
    let plan = plan(&steps, PASSES, RESOURCES, &facts(), &["c"]).expect("a plan");
    assert_eq!(plan.pass_names(), ["tint"]);
    assert_eq!(plan.steps[0].slots[0].1, Slot::Zero);
    assert!(plan.to_string().contains("left out: `blur.size` is 0"));
}

#[test]
fn a_buffer_has_an_element_for_each_reservoir_if_its_pass_runs_for_each() {
    const EACH: &[Pass] = &[Pass {
        name: "each",
        extent: Extent::Reservoirs,
        features: &[],
        variants: MAIN,
        bindings: &[Binding::write::<u32>("r")],
    }];
    let resources = [Resource::reservoirs::<u32>("r", Life::Transient)];
    let plan = plan(&[step("each")], EACH, &resources, &facts(), &["r"]).expect("a plan");
    assert_eq!((plan.pool.as_slice(), plan.output_bytes("r")), (&[4 * 8 * 3][..], Some(96)));
    let resources = [Resource::new::<u32>("r", Life::Transient)];
    let error = super::plan(&[step("each")], EACH, &resources, &facts(), &["r"]).expect_err("extents differ");
    assert_eq!(error.to_string(), "pass `each` writes `r` once for each reservoir, the resource table says each pixel");
}

#[test]
fn history_that_nobody_asks_for_is_not_doubled() {
    let resources = [Resource::new::<u32>("scene", Life::Scene), Resource::new::<u32>("a", Life::History)];
    let plan = plan(&[step("make")], PASSES, &resources, &facts(), &["a"]).expect("a plan");
    assert_eq!((plan.history.len(), plan.pool.as_slice()), (0, &[32][..]));
}
