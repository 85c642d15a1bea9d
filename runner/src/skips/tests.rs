use glam::Vec3;

use super::*;
use crate::{
    executor::cpu::Order,
    packed::PackedScene,
    render::{Backend, Request, facts_of},
    scene::{Scene, builtin},
    settings::Settings,
    technique::{Technique, ToneCurve, direct_light},
};

fn built_in(name: &str) -> Scene {
    (builtin::BUILTIN.iter().find(|scene| scene.name == name).expect("a built-in scene").build)()
}

/// Scenes that lack this and that: all but triangles in place; nothing that emits; a material that mirrors; shapes and
/// images; instances that move.
fn scenes() -> Vec<(&'static str, Scene)> {
    let mut dark = built_in("cornell");
    dark.materials.iter_mut().for_each(|material| material.emission = Vec3::ZERO);
    let mut sky = dark.clone();
    sky.environment = Some(crate::scene::Environment {
        name: "sky".to_owned(),
        width: 4,
        height: 2,
        texels: (1..=8).map(|i| [i as f32, 1.0, 0.5]).collect(),
        rotation_deg: 0.0,
        scale: 1.0,
    });
    let mut glossy = built_in("cornell");
    glossy.materials[0].metallic = 1.0;
    vec![
        ("cornell", built_in("cornell")),
        ("no light", dark),
        ("a sky alone", sky),
        ("gloss", glossy),
        ("studio", built_in("studio")),
    ]
}

#[test]
fn no_rule_changes_a_picture_by_a_bit() {
    for (name, scene) in scenes() {
        let camera = scene.camera.expect("it has one");
        for (technique, knobs) in [
            (Technique::RealTime, &[] as &[&str]),
            (Technique::RealTime, &["scene.time_step=0", "rays=quality", "candidates.source=tiles", "tiles.size=8"]),
            (Technique::RealTime, &["candidates.source=cells", "cells.slots=1", "spatial.rounds=1", "rays=speed"]),
            (Technique::Still, &[]),
            (Technique::Candidates, &["candidates.source=tree", "reservoirs.choice=inversion"]),
        ] {
            let mut packed = PackedScene::new(&scene, 0.0).expect("it fits");
            let mut settings = Settings::default();
            knobs.iter().for_each(|knob| settings.apply(knob).expect("a knob"));
            let request = Request::new(camera, [33, 20], technique, settings);
            let found = costs(&mut packed, &request, &Backend::Cpu(Order::default()), 1).expect("frames");
            assert_eq!(found.len(), Rule::ALL.len() + 2);
            for Cost { skips, different, .. } in &found {
                assert_eq!(*different, 0, "{name}, {technique}, {knobs:?}: {skips:?}");
            }
            let [none, .., all] = found.as_slice() else { unreachable!("more than two") };
            assert!(all.frame_bytes <= none.frame_bytes, "{name}: {all:?} {none:?}");
        }
    }
}

/// Each rule, where there is something to leave out, leaves something out.
#[test]
fn every_rule_leaves_out_what_it_says() {
    let packed = PackedScene::new(&built_in("cornell"), 0.0).expect("it fits");
    let plan = |skips: Skips, packed: &PackedScene| {
        let settings = Settings { skips, ..Settings::default() };
        let facts = facts_of(packed, 16, 16, &settings);
        direct_light(Technique::RealTime, &settings, &facts, ToneCurve::default(), &["moments"]).expect("a frame")
    };
    let mut plain = built_in("cornell");
    plain.instances.truncate(1);
    plain.materials.iter_mut().for_each(|material| (material.metallic, material.specular) = (0.0, Vec3::ZERO));
    let plain = PackedScene::new(&plain, 0.0).expect("it fits");
    let with = plan(Skips::default(), &plain);
    assert!(with.facts.features.is_empty(), "{:?}", with.facts.features);
    for feature in FEATURES {
        let without = plan(Skips::default().with(Rule::of(feature), false), &plain);
        assert_eq!(without.facts.features, [feature]);
        assert_eq!(without.left_out().len() + 1, with.left_out().len(), "{feature:?}");
    }

    let with = plan(Skips::default(), &packed);
    assert!(!with.pass_names().contains(&"display_agx"), "nobody reads it");
    let unread = plan(Skips::default().with(Rule::Unread, false), &packed);
    assert!(unread.pass_names().contains(&"display_agx") && unread.frame_bytes() >= with.frame_bytes());

    let (_, dark) = scenes().swap_remove(1);
    let dark = PackedScene::new(&dark, 0.0).expect("it fits");
    assert!(!plan(Skips::default(), &dark).pass_names().contains(&"candidates"));
    assert!(plan(Skips::default().with(Rule::Absent, false), &dark).pass_names().contains(&"candidates"));

    let mut packed = packed;
    let settings = Settings { skips: Skips::default().with(Rule::Updates, false), ..Settings::default() };
    let camera = built_in("cornell").camera.expect("it has one");
    for (settings, uploads) in [(Settings::default(), 0), (settings, 3)] {
        let request = Request::new(camera, [8, 8], Technique::RealTime, settings);
        let mut sequence = crate::sequence::Sequence::new(&mut packed, request);
        let shot = sequence.shot(0);
        sequence.next(&shot).expect("a frame");
        assert_eq!(sequence.next(&shot).expect("a frame").1.len(), uploads);
    }
}

#[test]
fn every_rule_has_a_knob_of_its_name() {
    for rule in Rule::ALL {
        let mut settings = Settings::default();
        assert!(settings.skips.is_on(rule));
        settings.apply(&format!("skip.{}=off", rule.name())).expect("a knob");
        assert_eq!(settings.skips, Skips::default().with(rule, false));
        settings.apply("preset=fast").expect("a preset");
        assert!(!settings.skips.is_on(rule), "a preset says nothing of it");
        settings.apply(&format!("skip.{}=on", rule.name())).expect("a knob");
        assert_eq!(settings.skips, Skips::default());
    }
}
