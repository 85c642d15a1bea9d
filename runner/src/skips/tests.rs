use glam::{Mat4, Vec3};
use weir_shared::{frame::FramePair, reservoir::Reservoir, surface::Surface};

mod tiles;

use super::*;
use crate::{
    executor::cpu::{CpuExecutor, Order},
    packed::{Moment, PackOptions, PackedScene},
    render::{Backend, Request, facts_of},
    scene::{Environment, Scene, Texture, builtin},
    sequence::{Sequence, Shot},
    settings::Settings,
    technique::{Technique, ToneCurve, direct_light},
};

fn built_in(name: &str) -> Scene {
    (builtin::BUILTIN.iter().find(|scene| scene.name == name).expect("a built-in scene").build)()
}

fn settings(knobs: &[&str]) -> Settings {
    let mut settings = Settings::default();
    knobs.iter().for_each(|knob| settings.apply(knob).expect("a knob"));
    settings
}

/// Cornell with walls that reflect nothing.
fn with_black() -> Scene {
    let mut black = built_in("cornell");
    let material = black.meshes[0].materials[0] as usize;
    (black.materials[material].base_color, black.materials[material].specular) = (Vec3::ZERO, Vec3::ZERO);
    black
}

/// Cornell with an image on its walls, of which every other texel is a hole if `masked`.
fn with_image(masked: bool) -> Scene {
    let mut scene = built_in("cornell");
    let texels = vec![0xffff_ffff, 0x00c0_8040, 0x0040_80c0, 0xffff_ffff];
    scene.textures.push(Texture { name: "checks".to_owned(), width: 2, height: 2, srgb: true, texels });
    for mesh in &mut scene.meshes {
        mesh.uvs = mesh.positions.iter().map(|p| p.truncate() * 4.0).collect();
    }
    let material = scene.meshes[0].materials[0] as usize;
    scene.materials[material].base_color_texture = Some(0);
    scene.materials[material].alpha_texture = masked.then_some(0);
    scene
}

fn bright_sky() -> Environment {
    Environment {
        name: "sky".to_owned(),
        width: 4,
        height: 2,
        texels: (1..=8).map(|i| [i as f32, 1.0, 0.5]).collect(),
        rotation_deg: 0.0,
        scale: 1.0,
    }
}

/// Scenes that lack this and that: all but triangles in place; nothing that emits; a material that mirrors; one that
/// reflects nothing; images and masks where nothing emits; shapes, and an image on what emits.
fn scenes() -> Vec<(&'static str, Scene)> {
    let mut dark = built_in("cornell");
    dark.materials.iter_mut().for_each(|material| material.emission = Vec3::ZERO);
    let sky = Scene { environment: Some(bright_sky()), ..dark.clone() };
    let mut glossy = built_in("cornell");
    glossy.materials[0].metallic = 1.0;
    vec![
        ("cornell", built_in("cornell")),
        ("no light", dark),
        ("a sky alone", sky),
        ("gloss", glossy),
        ("black", with_black()),
        ("image", with_image(false)),
        ("mask", with_image(true)),
        ("studio", built_in("studio")),
    ]
}

#[test]
fn no_rule_changes_a_picture_by_a_bit_but_those_that_draw_otherwise() {
    for (name, scene) in scenes() {
        let camera = scene.camera.expect("it has one");
        for (technique, knobs) in [
            (Technique::RealTime, &[] as &[&str]),
            (Technique::RealTime, &["scene.time_step=0", "rays=quality", "candidates.source=tiles", "tiles.size=8"]),
            (Technique::RealTime, &["scene.time_step=0", "camera.jitter=off", "preset=paper"]),
            (Technique::RealTime, &["candidates.source=cells", "cells.slots=1", "spatial.rounds=1", "rays=speed"]),
            (Technique::Still, &[]),
            (Technique::Still, &["camera.jitter=off", "candidates.count=9"]),
            (Technique::Candidates, &["candidates.source=tree", "reservoirs.choice=inversion"]),
        ] {
            let request = Request::new(camera, [33, 20], technique, settings(knobs));
            let found = costs(&scene, &request, &Backend::Cpu(Order::default()), 1, || true);
            let found = found.expect("frames").expect("nobody stops it");
            assert_eq!(found.len(), Rule::ALL.len() + 3);
            for Cost { skips, different, .. } in &found {
                let draws_apart =
                    Rule::ALL.into_iter().filter(|rule| rule.changes_draws() && skips.is_on(*rule)).count();
                let is_compared = draws_apart != 1 && *skips != found[found.len() - 2].skips;
                assert_eq!(*different, is_compared.then_some(0), "{name}, {technique}, {knobs:?}: {skips:?}");
            }
            let [none, .., all] = found.as_slice() else { unreachable!("more than two") };
            // What is kept from frame to frame has memory of its own.
            assert!(all.frame_bytes <= none.frame_bytes + 33 * 20 * 64, "{name}: {all:?} {none:?}");
            // Trees that tell where light has a closed form are memory that spares time.
            let of_trees = found.iter().find(|cost| cost.skips == Skips::none().with(Rule::ClosedForm, true));
            let more = of_trees.map_or(0, |cost| cost.scene_bytes - none.scene_bytes);
            assert!(all.scene_bytes <= none.scene_bytes + more, "{name}: {all:?} {none:?}");
        }
    }
}

fn plan_of(skips: Skips, knobs: &[&str], packed: &PackedScene) -> crate::graph::Plan {
    let settings = Settings { skips, ..settings(knobs) };
    let facts = facts_of(packed, 16, 16, &settings);
    direct_light(Technique::RealTime, &settings, &facts, ToneCurve::default(), &["moments"]).expect("a frame")
}

/// Each rule for code and passes, where there is something to leave out, leaves something out.
#[test]
fn every_rule_for_passes_leaves_out_what_it_says() {
    let packed = PackedScene::new(&built_in("cornell"), 0.0).expect("it fits");
    let mut plain = built_in("cornell");
    plain.instances.truncate(1);
    plain.materials.iter_mut().for_each(|material| (material.metallic, material.specular) = (0.0, Vec3::ZERO));
    let plain = PackedScene::new(&plain, 0.0).expect("it fits");
    let with = plan_of(Skips::default(), &[], &plain);
    assert!(with.facts.features.is_empty(), "{:?}", with.facts.features);
    for feature in FEATURES.into_iter().filter(|feature| *feature != Feature::CLOSED_FORM) {
        let without = plan_of(Skips::default().with(Rule::of(feature), false), &[], &plain);
        assert_eq!(without.facts.features, [feature]);
        assert_eq!(without.left_out().len() + 1, with.left_out().len(), "{feature:?}");
    }

    let with = plan_of(Skips::default(), &[], &packed);
    assert!(!with.pass_names().contains(&"display_agx"), "nobody reads it");
    let unread = plan_of(Skips::default().with(Rule::Unread, false), &[], &packed);
    assert!(unread.pass_names().contains(&"display_agx") && unread.frame_bytes() >= with.frame_bytes());

    let tiles = &["candidates.source=tiles"];
    let with = plan_of(Skips::default(), tiles, &packed);
    assert!(!with.pass_names().contains(&"presample_tiles"), "two lights are no more than a tile has records");
    let small = &["candidates.source=tiles", "tiles.size=1"];
    assert!(plan_of(Skips::default(), small, &packed).pass_names().contains(&"presample_tiles"));
    let without = plan_of(Skips::default().with(Rule::Presampling, false), tiles, &packed);
    assert!(without.pass_names().contains(&"presample_tiles") && without.frame_bytes() > with.frame_bytes());

    let (_, dark) = scenes().swap_remove(1);
    let dark = PackedScene::new(&dark, 0.0).expect("it fits");
    assert!(!plan_of(Skips::default(), &[], &dark).pass_names().contains(&"candidates"));
    assert!(plan_of(Skips::default().with(Rule::Absent, false), &[], &dark).pass_names().contains(&"candidates"));

    let mut packed = packed;
    let camera = built_in("cornell").camera.expect("it has one");
    for (knobs, uploads) in
        [(&[] as &[&str], 0), (&["skip.updates=off"], 0), (&["skip.updates=off", "skip.still=off"], 3)]
    {
        let request = Request::new(camera, [8, 8], Technique::RealTime, settings(knobs));
        let mut sequence = Sequence::new(&mut packed, request);
        let shot = sequence.shot(0);
        // Into both blocks.
        for _ in 0..2 {
            sequence.next(&shot).expect("a frame");
        }
        assert_eq!(sequence.next(&shot).expect("a frame").1.len(), uploads);
    }
}

/// What the frame says of the scene it lists, unless that rule is off.
#[test]
fn what_frames_do_without_is_listed() {
    let packed = PackedScene::new(&built_in("cornell"), 0.0).expect("it fits");
    let knobs = &["preset=paper", "camera.jitter=off"];
    for (rule, what) in [
        (Rule::Few, "drawing lights"),
        (Rule::Trees, "light trees"),
        (Rule::Updates, "updates"),
        (Rule::Primary, "camera rays"),
        (Rule::Tiles, "tiles"),
    ] {
        let is_listed = |skips| plan_of(skips, knobs, &packed).left_out().iter().any(|(said, _)| *said == what);
        assert!(is_listed(Skips::default()), "{what}");
        assert!(!is_listed(Skips::default().with(rule, false)), "{what}");
    }
    let moving = PackedScene::new(&built_in("park"), 0.0).expect("it fits");
    let spared = |skips| plan_of(skips, &[], &moving).facts.spared;
    let still = ("updates", "of what stands still");
    assert_eq!(spared(Skips::default()).len(), 2);
    assert!(spared(Skips::default()).contains(&still));
    assert!(!spared(Skips::default().with(Rule::Still, false)).contains(&still));
    let lacks = packed.content.lacks();
    assert!(
        lacks.contains(&"images") && lacks.contains(&"motion") && !lacks.contains(&"triangles or shapes that emit")
    );
    assert!(!moving.content.lacks().contains(&"motion"));
    for what in ["lights that shine to both sides", "lights of different power"] {
        assert!(lacks.contains(&what), "{what}");
    }
    assert!(!lacks.contains(&"a second material"));
    let mut other = built_in("cornell");
    other.materials.iter_mut().for_each(|material| material.two_sided_emission = true);
    other.meshes[3].positions[0].x -= 0.1;
    let other = PackedScene::new(&other, 0.0).expect("it fits").content;
    assert!(other.two_sided && other.powers && other.materials, "{other:?}");
    let mut second = built_in("cornell");
    second.instances.push(second.instances[3].clone());
    let lamps = Moment { emission: vec![(4, Vec3::splat(2.0))], ..Moment::default() };
    let mut second = PackedScene::dynamic(&second, &lamps).expect("it fits");
    assert!(second.content.powers, "one lamp is twice as bright");
    second.advance(&Moment::default()).expect("shown");
    assert!(!second.content.powers, "they are alike");
}

/// The rule decides, even where the scene was packed for both.
#[test]
fn light_in_closed_form_is_sampled_without_the_rule() {
    let scene = built_in("cornell");
    let camera = scene.camera.expect("it has one");
    let options = PackOptions { closed_form: true, ..PackOptions::default() };
    let packed = PackedScene::with(&scene, &Moment::default(), options).expect("it fits");
    for (rule, is_on) in [("on", true), ("off", false)] {
        let mut frames = Frames::new(&packed, camera, &[&format!("skip.closed_form={rule}")], &["surfaces", "fresh"]);
        frames.run(&packed);
        let (surfaces, fresh) = (frames.output::<Surface>("surfaces"), frames.output::<Reservoir>("fresh"));
        let settled = surfaces.iter().zip(&fresh).filter(|(surface, _)| surface.is_settled() && !surface.is_sky());
        assert!(settled.clone().all(|(_, held)| *held == Reservoir::EMPTY));
        assert_eq!(settled.count() > 100, is_on);
        assert_eq!(frames.plan.left_out().iter().any(|(what, _)| *what == "sampling"), is_on);
    }
}

/// Frames of a still camera on the CPU, with these outputs.
struct Frames {
    plan: crate::graph::Plan,
    executor: CpuExecutor,
    frames: FramePair,
}

impl Frames {
    fn new(packed: &PackedScene, camera: crate::scene::Camera, knobs: &[&str], outputs: &[&'static str]) -> Self {
        let settings = settings(knobs);
        let request = Request::new(camera, [24, 24], Technique::Candidates, settings.clone());
        let facts = facts_of(packed, 24, 24, &settings);
        let plan = direct_light(request.technique, &settings, &facts, ToneCurve::default(), outputs).expect("a frame");
        let now = crate::render::frame_of(packed, &request);
        let executor = CpuExecutor::new(&plan);
        Self { plan, executor, frames: FramePair { now, prev: now } }
    }

    fn run(&mut self, packed: &PackedScene) {
        self.executor.run(&self.plan, packed.buffers(), &self.frames);
    }

    fn output<T: bytemuck::Pod>(&self, name: &str) -> Vec<T> {
        bytemuck::cast_slice(self.executor.output(&self.plan, name).expect("an output")).to_vec()
    }
}

/// Of reservoirs that call a hidden sample visible, the rule believes them, and without it a ray finds out.
#[test]
fn what_is_known_to_be_visible_costs_no_ray() {
    let scene = built_in("cornell");
    let (packed, camera) = (PackedScene::new(&scene, 0.0).expect("it fits"), scene.camera.expect("it has one"));
    let mut frames = Frames::new(&packed, camera, &[], &["surfaces", "fresh", "visible"]);
    frames.run(&packed);
    let surfaces: Vec<Surface> = frames.output("surfaces");
    let (fresh, visible) = (frames.output::<Reservoir>("fresh"), frames.output::<Reservoir>("visible"));
    let claimed: Vec<Reservoir> =
        fresh.iter().map(|held| if held.has_sample() { held.known_visible() } else { *held }).collect();
    let view =
        weir_shared::scene::Scene { triangles: &packed.triangles, records: &packed.records, texels: &packed.texels };
    let mut hidden = 0;
    for (i, (claimed, visible)) in (0..).zip(claimed.iter().zip(&visible)) {
        let px = glam::UVec2::new(i % 24, i / 24);
        let look = |rule: bool| {
            let not_skipped = Skips::default().with(Rule::Known, rule).in_passes();
            let frame = weir_shared::frame::Frame { not_skipped, ..frames.frames.now };
            let reservoirs: Vec<Reservoir> = vec![*claimed; 24 * 24];
            weir_shader::visibility::visibility::<false, false, true>(
                px,
                0,
                &frame,
                &view,
                packed.bvh.as_slice(),
                &surfaces,
                &reservoirs,
            )
        };
        assert_eq!(look(true), *claimed);
        if claimed.has_sample() {
            assert_eq!(look(false).ucw, visible.ucw, "pixel {px}");
            hidden += u32::from(visible.ucw == 0.0);
        }
    }
    assert!(hidden > 10, "{hidden}");
}

#[test]
fn surfaces_that_reflect_nothing_cost_neither_rays_nor_candidates() {
    let scene = with_black();
    let (packed, camera) = (PackedScene::new(&scene, 0.0).expect("it fits"), scene.camera.expect("it has one"));
    let outputs = ["surfaces", "bsdf_hits", "fresh"];
    let [with, without] = ["on", "off"].map(|rule| {
        let mut frames = Frames::new(&packed, camera, &[&format!("skip.black={rule}"), "candidates.bsdf=1"], &outputs);
        frames.run(&packed);
        (
            frames.output::<Surface>("surfaces"),
            frames.output::<Reservoir>("bsdf_hits"),
            frames.output::<Reservoir>("fresh"),
        )
    });
    assert_eq!(with.2, without.2);
    let black: Vec<usize> = (0..with.0.len()).filter(|&i| !with.0[i].is_sky() && with.0[i].is_black()).collect();
    assert!(black.len() > 20, "{}", black.len());
    let found = |hits: &[Reservoir]| black.iter().filter(|&&i| hits[i].has_sample()).count();
    assert_eq!(found(&with.1), 0);
    assert!(found(&without.1) > 0);
    assert!(black.iter().all(|&i| !with.2[i].has_sample() && with.2[i].confidence() == 1));
}

/// Rays of reuse that are left out report nothing, and nothing is lost by that.
#[test]
fn rays_of_reuse_to_what_cannot_matter_are_left_out() {
    let scene = built_in("cornell");
    let camera = scene.camera.expect("it has one");
    let mut packed = PackedScene::new(&scene, 0.0).expect("it fits");
    // Neighbours around corners, so that some face away from what lights the pixel.
    let marks = |packed: &mut PackedScene, rule: &str| {
        let knobs =
            [&format!("skip.unlit={rule}"), "reuse.normal=180", "reuse.plane=1", "reuse.radius=12", "rays=quality"];
        let settings = settings(&knobs);
        let facts = facts_of(packed, 24, 24, &settings);
        let outputs = ["temporal_marked", "moments"];
        let plan =
            direct_light(Technique::RealTime, &settings, &facts, ToneCurve::default(), &outputs).expect("a frame");
        let mut executor = CpuExecutor::new(&plan);
        let mut sequence = Sequence::new(&mut *packed, Request::new(camera, [24, 24], Technique::RealTime, settings));
        for number in 0..3 {
            let shot = sequence.shot(number);
            let (frames, _) = sequence.next(&shot).expect("a frame");
            executor.run(&plan, sequence.packed().buffers(), &frames);
        }
        let bytes = |name: &str| executor.output(&plan, name).expect("an output").to_vec();
        let marked: Vec<Reservoir> = bytemuck::cast_slice(&bytes("temporal_marked")).to_vec();
        let hidden = marked.iter().map(|held| (0..13).filter(|i| held.is_hidden(*i)).count()).sum::<usize>();
        (hidden, bytes("moments"))
    };
    let (with, without) = (marks(&mut packed, "on"), marks(&mut packed, "off"));
    assert_eq!(with.1, without.1);
    assert!(with.0 < without.0, "{} {}", with.0, without.0);
}

/// Where it is said that lights are not drawn, what they would be drawn by does not matter; elsewhere it does.
#[test]
fn lights_that_can_all_be_candidates_are_not_drawn() {
    let mut sky = built_in("cornell");
    sky.environment = Some(bright_sky());
    for (name, scene) in [("cornell", built_in("cornell")), ("sky", sky)] {
        let camera = scene.camera.expect("it has one");
        let mut listed = [0, 0];
        for count in 1..=6 {
            for rule in ["on", "off"] {
                let knobs = [&format!("skip.few={rule}"), &format!("candidates.count={count}"), "candidates.bsdf=0"];
                let mut packed = PackedScene::new(&scene, 0.0).expect("it fits");
                let mut fresh = || {
                    let mut frames = Frames::new(&packed, camera, &knobs, &["fresh"]);
                    frames.run(&packed);
                    // The table over the environment comes last.
                    let emitters = packed.frame.environment_table_at.max(1) as usize;
                    let end = if packed.content.distant { emitters } else { packed.lights.len() };
                    packed.lights[..end].fill(0);
                    (frames.output::<Reservoir>("fresh"), frames.plan.left_out())
                };
                let ((with, left_out), (without, _)) = (fresh(), fresh());
                let is_listed = left_out.iter().any(|(what, _)| *what == "drawing lights");
                assert_eq!(with == without, is_listed, "{name}, {count} candidates, rule {rule}");
                listed[usize::from(is_listed)] += 1;
            }
        }
        assert!(listed.iter().all(|count| *count > 2), "{name}: {listed:?}");
    }
}

/// Light trees of meshes and over them are not built for settings that send no candidate down; and one that was not kept up
/// to date is built when that changes.
#[test]
fn light_trees_are_built_where_candidates_come_down() {
    let scene = built_in("rooms");
    let pack = |knobs: &[&str]| {
        let options = PackOptions::of(&settings(knobs));
        PackedScene::with(&scene, &Moment::default(), options).expect("it fits")
    };
    let (with, without) = (pack(&[]), pack(&["candidates.tree=0"]));
    assert!(with.content.light_tree && !without.content.light_tree);
    assert!(with.light_costs.tree.bytes > 0 && without.light_costs.tree.bytes == 0);
    assert!(without.lights.len() < with.lights.len());
    assert_eq!(pack(&["candidates.tree=0", "skip.trees=off"]).lights.len(), with.lights.len());
    // Settings that ask for what is not there draw by power.
    let camera = scene.camera.expect("it has one");
    let tree = Request::new(camera, [8, 8], Technique::RealTime, settings(&["candidates.source=tree"]));
    let frame = crate::render::frame_of(&without, &tree);
    assert_eq!((frame.source, frame.candidates_tree), (weir_shared::light::source::POWER, 0));

    let mut scene = built_in("studio");
    let emits = |m: &u32| scene.materials[*m as usize].emission != Vec3::ZERO;
    let is_lamp = |i: &u32| scene.meshes[scene.instances[*i as usize].mesh as usize].materials.iter().any(emits);
    let lamp = (0..scene.instances.len() as u32).find(is_lamp).expect("it has a lamp");
    scene.instances.iter_mut().for_each(|instance| instance.motion = crate::scene::Motion::Still);
    let moment =
        |x: f32| Moment { placed: vec![(lamp, Mat4::from_translation(Vec3::new(x, 0.0, 0.0)))], ..Moment::default() };
    let mut packed = PackedScene::dynamic(&scene, &moment(0.0)).expect("it fits");
    let shot = |x: f32| Shot { moment: moment(x), camera };
    let mut sequence =
        Sequence::new(&mut packed, Request::new(camera, [8, 8], Technique::RealTime, settings(&["candidates.tree=0"])));
    let mut lights_after = |knobs: &[&str], x: f32| {
        sequence.tune(&settings(knobs));
        let changed = sequence.next(&shot(x)).expect("a frame").1.len();
        (changed, sequence.packed().lights.clone())
    };
    let (_, stale) = lights_after(&["candidates.tree=0"], 0.25);
    assert_eq!(lights_after(&["candidates.tree=0"], 0.25), (0, stale.clone()));
    let (changed, current) = lights_after(&["candidates.tree=3"], 0.25);
    assert!(changed > 0, "the tree is built for the moment that is shown already");
    assert_ne!(stale, current);
    let anew = PackedScene::dynamic(&scene, &moment(0.25)).expect("it fits");
    assert_eq!(current, anew.lights);
    assert_eq!(lights_after(&["candidates.tree=3"], 0.25), (0, current));
    // Others may send candidates down.
    sequence.tune(&settings(&["candidates.tree=0"]));
    sequence.keeps_tree = true;
    sequence.next(&shot(0.5)).expect("a frame");
    let anew = PackedScene::dynamic(&scene, &moment(0.5)).expect("it fits");
    assert_eq!(sequence.packed().lights, anew.lights);
}

/// What happens to a scene or its camera between two frames.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Change {
    Nothing,
    /// A shape, which no ray finds, moves and emits otherwise.
    Shape,
    Mesh,
    Emission,
    Order,
    Camera,
    Environment,
}

/// Camera rays are left out in the third frame that sees the same: what was planted in their results stays. And pictures
/// are those of camera rays.
#[test]
fn camera_rays_are_left_out_while_the_camera_sees_the_same() {
    let scene = built_in("studio");
    let camera = scene.camera.expect("it has one");
    let triangles = |i: &u32| scene.meshes[scene.instances[*i as usize].mesh as usize].triangles.len();
    let mut all = 0..scene.instances.len() as u32;
    let shape = all.clone().find(|i| triangles(i) == 0).expect("a shape");
    let mesh = all.find(|i| triangles(i) > 0).expect("a mesh");
    let shot = |change: Change, number: u32| {
        let step = number as f32;
        let placed = |instance: u32| {
            let before = scene.instances[instance as usize].world_from_object;
            vec![(instance, Mat4::from_translation(Vec3::new(0.01 * step, 0.0, 0.0)) * before)]
        };
        let moment = match change {
            Change::Shape => {
                Moment { placed: placed(shape), emission: vec![(shape, Vec3::splat(1.0 + step))], ..Moment::default() }
            }
            Change::Mesh => Moment { placed: placed(mesh), ..Moment::default() },
            Change::Emission => Moment { emission: vec![(mesh, Vec3::splat(1.0 + step))], ..Moment::default() },
            Change::Order => {
                let mut drawn: Vec<u32> = (0..scene.instances.len() as u32).collect();
                drawn.rotate_left(number as usize);
                Moment { drawn: Some(drawn), ..Moment::default() }
            }
            Change::Nothing | Change::Camera | Change::Environment => Moment::default(),
        };
        let aside = if change == Change::Camera { 0.01 * step } else { 0.0 };
        Shot { moment, camera: crate::scene::Camera { origin: camera.origin + Vec3::X * aside, ..camera } }
    };
    // Results of the last frame of four.
    let last = |knobs: &[&str], technique: Technique, change: Change, plants: bool| {
        let mut packed = PackedScene::dynamic(&scene, &Moment::default()).expect("it fits");
        let settings = settings(knobs);
        let facts = facts_of(&packed, 16, 16, &settings);
        let outputs = ["surfaces", "emitted", "moments"];
        let plan = direct_light(technique, &settings, &facts, ToneCurve::default(), &outputs).expect("a frame");
        let mut executor = CpuExecutor::new(&plan);
        let mut sequence = Sequence::new(&mut packed, Request::new(camera, [16, 16], technique, settings.clone()));
        for number in 0..4 {
            if change == Change::Environment {
                sequence.packed_mut().turn_environment(number as f32, 1.0);
            }
            let (frames, _) = sequence.next(&shot(change, number)).expect("a frame");
            executor.run(&plan, sequence.packed().buffers(), &frames);
            if plants && number < 2 {
                // In both halves of what is doubled.
                for name in ["surfaces", "emitted"] {
                    executor.output_mut(&plan, name).expect("an output")[..16].fill(0x3f);
                }
            }
        }
        ["surfaces", "emitted", "moments"].map(|name| executor.output(&plan, name).expect("an output").to_vec())
    };
    for technique in [Technique::RealTime, Technique::Still] {
        for change in [
            Change::Nothing,
            Change::Shape,
            Change::Mesh,
            Change::Emission,
            Change::Order,
            Change::Camera,
            Change::Environment,
        ] {
            let pictures = ["on", "off"].map(|rule| {
                let knobs = ["camera.jitter=off", &format!("skip.primary={rule}")];
                last(&knobs, technique, change, false)
            });
            assert_eq!(pictures[0], pictures[1], "{technique}, {change:?}");
            for (knobs, jitter) in [
                (&["camera.jitter=off"] as &[&str], false),
                (&[], true),
                (&["camera.jitter=off", "skip.primary=off"], true),
            ] {
                let is_kept = !jitter && matches!(change, Change::Nothing | Change::Shape);
                let [surfaces, emitted, _] = last(knobs, technique, change, true);
                let stays = (surfaces[..16] == [0x3f; 16], emitted[..16] == [0x3f; 16]);
                assert_eq!(stays, (is_kept, is_kept), "{technique}, {change:?}, {knobs:?}");
            }
        }
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
