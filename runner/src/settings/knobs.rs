//! The knobs.

use std::{fmt::Display, str::FromStr};

use weir_shared::{
    light::source, light_cuts::MOST_NODES, merge::form, resample::choice, reuse::lattice, reuse::rule,
    target::occlusion,
};

use super::{Preset, Rays, Settings};
use crate::{executor::gpu::Traversal, packed::TreeUpdate, skips::Rule, technique::MAX_ROUNDS};

/// A knob.
pub struct Knob {
    /// What stands before the equals sign.
    pub key: &'static str,
    /// What may stand behind it.
    pub values: &'static str,
    /// What more and less of it do, or what each value does; without the default, see [`Knob::shown_help`].
    pub help: &'static str,
    set: fn(&mut Settings, &str) -> bool,
    get: fn(&Settings) -> String,
}

impl Knob {
    /// Sets it; false if the value is none of [`Knob::values`].
    pub fn set(&self, settings: &mut Settings, value: &str) -> bool {
        (self.set)(settings, value)
    }

    /// Its help and its default.
    pub fn shown_help(&self) -> String {
        format!("{}. Default {}", self.help, self.get(&Settings::default()))
    }

    /// Its value in `settings`, as [`Knob::set`] takes it; nothing if no value of it gives these settings.
    pub fn get(&self, settings: &Settings) -> String {
        (self.get)(settings)
    }
}

fn number<T: FromStr + PartialOrd>(target: &mut T, text: &str, low: T, high: T) -> bool {
    match text.parse() {
        Ok(value) if value >= low && value <= high => {
            *target = value;
            true
        }
        _ => false,
    }
}

/// One of several named values.
fn named<T: Copy>(target: &mut T, text: &str, values: &[(&str, T)]) -> bool {
    match values.iter().find(|(name, _)| *name == text) {
        Some((_, value)) => {
            *target = *value;
            true
        }
        None => false,
    }
}

fn name_of<T: Copy + PartialEq>(value: T, values: &[(&'static str, T)]) -> String {
    values.iter().find(|(_, v)| *v == value).map_or_else(String::new, |(name, _)| (*name).to_owned())
}

fn text(value: impl Display) -> String {
    value.to_string()
}

/// `settings` with everything that `preset` decides.
fn with_preset(settings: &Settings, preset: Preset) -> Settings {
    let Settings { jitter, camera_rays, path_length, time_s, time_step_s, skips, .. } = *settings;
    Settings { jitter, camera_rays, path_length, time_s, time_step_s, skips, ..preset.settings() }
}

const SOURCES: &[(&str, u32)] = &[
    ("power", source::POWER),
    ("uniform", source::UNIFORM),
    ("tiles", source::TILES),
    ("cells", source::CELLS),
    ("tree", source::TREE),
    ("cuts", source::CUTS),
];
const TREE_UPDATES: &[(&str, TreeUpdate)] = &[("rebuild", TreeUpdate::Rebuild), ("refit", TreeUpdate::Refit)];
const SWITCH: &[(&str, bool)] = &[("on", true), ("off", false)];
const CHOICES: &[(&str, u32)] = &[
    ("threshold", choice::THRESHOLD),
    ("plain", choice::PLAIN),
    ("keys", choice::KEYS),
    ("inversion", choice::INVERSION),
];
const TRAVERSALS: &[(&str, Traversal)] =
    &[("auto", Traversal::Auto), ("software", Traversal::Software), ("hardware", Traversal::Hardware)];

const RAYS: &[(&str, Rays)] = &[
    ("speed", Rays::Speed),
    ("balanced", Rays::Balanced),
    ("quality", Rays::Quality),
    ("before", Rays::Before),
    ("after", Rays::Speed),
    ("both", Rays::Both),
    ("none", Rays::None),
];
const FORMS: &[(&str, u32)] = &[
    ("pairwise-defensive", form::PAIRWISE_DEFENSIVE),
    ("pairwise", form::PAIRWISE),
    ("balance", form::BALANCE),
    ("contribution", form::CONTRIBUTION),
    ("1/z", form::ONE_OVER_Z),
    ("1/m", form::ONE_OVER_M),
];
const RULES: &[(&str, u32)] = &[("disk", rule::DISK), ("compatible", rule::COMPATIBLE), ("paired", rule::PAIRED)];
const OCCLUSIONS: &[(&str, u32)] = &[("none", occlusion::NONE), ("screen", occlusion::SCREEN)];
const LATTICES: &[(&str, u32)] =
    &[("full", lattice::FULL), ("checkerboard", lattice::CHECKERBOARD), ("half", lattice::HALF)];

/// The switch of a rule that leaves work out.
macro_rules! skip {
    ($name:literal, $rule:ident, $what:literal) => {
        Knob {
            key: concat!("skip.", $name),
            values: "on or off",
            help: concat!($what, ". on: left out; off: done all the same, to see what that costs"),
            set: |s, text| {
                let mut on = true;
                let known = named(&mut on, text, SWITCH);
                if known {
                    s.skips = s.skips.with(Rule::$rule, on);
                }
                known
            },
            get: |s| name_of(s.skips.is_on(Rule::$rule), SWITCH),
        }
    };
}

/// Every knob there is.
pub const KNOBS: &[Knob] = &[
    Knob {
        key: "preset",
        values: "fast, balanced, quality or paper",
        help: "all the knobs of sampling, reuse and rays together; give it first. fast: the least time a frame, 1 \
               shadow ray a pixel. balanced: less noise, for 1 ray by the BSDF and, in real time, 3 shadow rays at \
               most. quality: the least noise in real time, for 1 ray by the BSDF, 1 shadow ray to the fresh sample, \
               and in each merge 1 from a partner and 1 to the sample of every other input. paper: the setting of \
               the first paper, 32 candidates, 3 neighbours within 30 pixels (its faster and biased form has 5, with \
               `reuse.mis=1/m` and `rays=before`), 20 frames of history, shadow rays as in quality, none by the BSDF",
        set: |s, text| {
            let Some(preset) = Preset::ALL.into_iter().find(|p| p.name() == text) else { return false };
            *s = with_preset(s, preset);
            true
        },
        get: |s| {
            let preset = Preset::ALL.into_iter().find(|p| with_preset(s, *p) == *s);
            preset.map_or_else(String::new, |p| text(p.name()))
        },
    },
    Knob {
        key: "candidates.count",
        values: "1 to 4096",
        help: "light samples offered to each reservoir in a frame. More: less noise a frame; less: faster frames. \
               With no more lights than this, each light is offered once",
        set: |s, text| number(&mut s.candidates, text, 1, 4096),
        get: |s| text(s.candidates),
    },
    Knob {
        key: "candidates.source",
        values: "power, uniform, tiles, cells, tree or cuts",
        help: "how these are drawn from the emissive triangles. power: by emitted power, less noise where some \
               lights are much brighter than others; uniform: all alike, less noise where the brightest are out of \
               sight; tiles: from lights drawn ahead by power, a tile of which each block of 8x8 pixels shares, the same \
               law in less time where lights are more than a cache holds, but neighbours get the same ones (as power \
               where there are no more lights than a tile has records); cells: from \
               lights resampled for cells of space around the camera, near ones more often, for time that does not \
               depend on the size of the picture; tree: down the light tree alone, near and facing ones more often, for \
               time on each; cuts: near ones more often too, from clusters that each block of 8x8 pixels shares",
        set: |s, text| named(&mut s.source, text, SOURCES),
        get: |s| name_of(s.source, SOURCES),
    },
    Knob {
        key: "candidates.tree",
        values: "0 to 256",
        help: "how many of these come down a tree over the lights, which knows where they are and where they face; one at \
               least is left to `candidates.source`, if that is another. More: less noise where lights are many and the near ones matter; \
               less: faster frames",
        set: |s, text| number(&mut s.candidates_tree, text, 0, 256),
        get: |s| text(s.candidates_tree),
    },
    Knob {
        key: "candidates.tree_update",
        values: "rebuild or refit",
        help: "what becomes of that tree's upper level when instances move. rebuild: built anew for each frame, the best \
               choice of lights; refit: nodes are fitted to where their lights are now, in a fraction of that time, but \
               which lights they hold together stays as it was, until instances come or go",
        set: |s, text| named(&mut s.tree_update, text, TREE_UPDATES),
        get: |s| name_of(s.tree_update, TREE_UPDATES),
    },
    Knob {
        key: "candidates.bsdf",
        values: "0 or 1",
        help: "rays in directions drawn from the BSDF, whose hits are candidates too. More: less noise where glossy \
               surfaces mirror lights, or lights are near; less: a ray less. With reuse they need `rays=balanced` or \
               `quality`, and are left out otherwise: they never find what is hidden",
        set: |s, text| number(&mut s.candidates_bsdf, text, 0, 1),
        get: |s| text(s.candidates_bsdf),
    },
    Knob {
        key: "candidates.full",
        values: "0 to 64",
        help: "groups of the light table's candidates (the tree's stay apart) that compete by irradiance before one of \
               each meets the full target. More: closer to the full target for all, which 0 and as many groups as \
               candidates stand for; less: fewer evaluations of the BSDF",
        set: |s, text| number(&mut s.candidates_full, text, 0, 64),
        get: |s| text(s.candidates_full),
    },
    Knob {
        key: "candidates.off_lattice",
        values: "1 to 4096",
        help: "as `candidates.count`, for pixels that `reuse.resolution` leaves out. More: less noise there; less: \
               faster frames",
        set: |s, text| number(&mut s.candidates_off_lattice, text, 1, 4096),
        get: |s| text(s.candidates_off_lattice),
    },
    Knob {
        key: "tiles.count",
        values: "1 to 4096",
        help: "tiles of `candidates.source=tiles`. More: fewer blocks of pixels that have the same lights in a frame; \
               less: less time and memory for drawing ahead",
        set: |s, text| number(&mut s.tile_count, text, 1, 4096),
        get: |s| text(s.tile_count),
    },
    Knob {
        key: "tiles.size",
        values: "1 to 4096",
        help: "lights of each tile, rounded up to a power of two. More: less alike within a block of pixels; less: less time and memory for drawing \
               ahead",
        set: |s, text| number(&mut s.tile_size, text, 1, 4096),
        get: |s| text(s.tile_size),
    },
    Knob {
        key: "cells.size",
        values: "0.0001 to 10",
        help: "edge of the smallest cells of `candidates.source=cells`, as a share of the diagonal of the scene; eight of \
               them stand in a row around the camera, then come cells of twice the edge, and so on, six times in all. \
               More: cells reach further; less: they know better which lights are near",
        set: |s, text| number(&mut s.cell_size, text, 1e-4, 10.0),
        get: |s| text(s.cell_size),
    },
    Knob {
        key: "cells.slots",
        values: "1 to 256",
        help: "lights that are kept for each cell. More: less alike within a cell; less: less time and memory",
        set: |s, text| number(&mut s.cell_slots, text, 1, 256),
        get: |s| text(s.cell_slots),
    },
    Knob {
        key: "cuts.size",
        values: "1 to 16",
        help: "clusters of lights in the cut of a block of 8x8 pixels with `candidates.source=cuts`; candidates are spread \
               over them evenly. More: clusters that the block's surface tells apart better; less: less time for cuts. \
               With no more than there are candidates, each cluster has one at least",
        set: |s, text| number(&mut s.cut_size, text, 1, MOST_NODES),
        get: |s| text(s.cut_size),
    },
    Knob {
        key: "cells.candidates",
        values: "1 to 256",
        help: "lights drawn by power for each that a cell keeps. More: closer to what matters there; less: less time",
        set: |s, text| number(&mut s.cell_candidates, text, 1, 256),
        get: |s| text(s.cell_candidates),
    },
    Knob {
        key: "reservoirs.count",
        values: "1 to 8",
        help: "reservoirs of each pixel, each with candidates, reuse and rays of its own. More: less noise, for as \
               many times the rays, time and memory; less: faster",
        set: |s, text| number(&mut s.reservoirs, text, 1, 8),
        get: |s| text(s.reservoirs),
    },
    Knob {
        key: "reservoirs.choice",
        values: "threshold, plain, keys or inversion",
        help: "how one sample of a stream is chosen; the law is the same, and so is the noise. threshold: a random \
               number only when another sample is kept; plain: one for each sample; keys: one for each sample, and a \
               logarithm; inversion: one for all, by the cumulative distribution of candidates that stay in memory, 20 \
               bytes each, which is what streams replace (merges choose as by plain)",
        set: |s, text| named(&mut s.choice, text, CHOICES),
        get: |s| name_of(s.choice, CHOICES),
    },
    Knob {
        key: "rays",
        values: "speed, balanced, quality, before, after, both or none",
        help: "shadow rays of each pixel, beside the ray of `candidates.bsdf`. speed (or after): 1, to the sample \
               that is shaded; the fastest. balanced: 1 to the fresh sample and, in each merge, 1 from a partner and \
               1 to the sample that is kept, so 3 at most in real time; less noise. quality: 1 to the fresh sample \
               and, in each merge, 1 from a partner and 1 to the sample of every other input; the least noise a \
               frame, the slowest. All of these are unbiased. before: 1 before reuse, shadows are wrong where \
               neighbours differ; both: that and 1 after, too dark there; none: no shadows; these are biased, for \
               comparison",
        set: |s, text| named(&mut s.rays, text, RAYS),
        get: |s| name_of(s.rays, RAYS),
    },
    Knob {
        key: "rays.traversal",
        values: "auto, software or hardware",
        help: "how a GPU finds what rays meet; the picture is the same but for triangles at equal distances, and for rays \
               that pass through edges. software: through weir's own nodes, on every adapter. hardware: by ray queries \
               of the driver, faster where the GPU has units for them; where it has no queries, or not for so large a \
               scene, a message says so and software goes on. auto: by ray queries on hardware that has them",
        set: |s, text| named(&mut s.traversal, text, TRAVERSALS),
        get: |s| name_of(s.traversal, TRAVERSALS),
    },
    Knob {
        key: "shade.sum",
        values: "on or off",
        help: "with `rays=quality`: what is shaded. on: the sum over all inputs of the last merge, less noise, in \
               colour above all; off: the one sample that is kept",
        set: |s, text| named(&mut s.sum, text, SWITCH),
        get: |s| name_of(s.sum, SWITCH),
    },
    Knob {
        key: "reuse.mis",
        values: "pairwise-defensive, pairwise, balance, contribution, 1/z or 1/m",
        help: "weights of merging. pairwise-defensive: time in proportion to the inputs, and the pixel's own sample \
               keeps a share whatever the others are like; pairwise: the same time without that share, less noise \
               where inputs are alike, more where they are not. The others take time by the square of the inputs, \
               and need `rays=speed`. balance: the least variance; contribution and 1/z: more of it, for comparison \
               with older work; 1/m: biased, too dark where an input could not have had the sample, for comparison",
        set: |s, text| named(&mut s.mis_form, text, FORMS),
        get: |s| name_of(s.mis_form, FORMS),
    },
    Knob {
        key: "reuse.radius",
        values: "1 to 120",
        help: "how far away neighbours may be, in pixels. More: less alike, so less of use, but less correlated; \
               less: blotches",
        set: |s, text| number(&mut s.radius_px, text, 1.0, 120.0),
        get: |s| text(s.radius_px),
    },
    Knob {
        key: "reuse.rule",
        values: "disk, compatible or paired",
        help: "how neighbours are found, by geometry alone. disk: similar surfaces at evenly spread points, with \
               three tries for each; compatible: the most similar of sixteen such points, so eight at most: closer \
               matches, for more surfaces to look at; paired: pixels that have each other, with one try for each: \
               the least to look at, but fewer neighbours at edges",
        set: |s, text| named(&mut s.neighbor_rule, text, RULES),
        get: |s| name_of(s.neighbor_rule, RULES),
    },
    Knob {
        key: "reuse.normal",
        values: "0 to 180",
        help: "largest angle between the normals of neighbours, in degrees. More: more neighbours at edges, less \
               alike; less: fewer neighbours on curved surfaces, so more noise there",
        set: |s, text| number(&mut s.normal_angle_deg, text, 0.0, 180.0),
        get: |s| text(s.normal_angle_deg),
    },
    Knob {
        key: "reuse.plane",
        values: "0 to 10",
        help: "how far a neighbour may lie off the tangent plane, as a share of the distance to the camera. More: \
               more neighbours in depth, less alike; less: fewer neighbours on uneven surfaces, so more noise there",
        set: |s, text| number(&mut s.plane_tolerance, text, 0.0, 10.0),
        get: |s| text(s.plane_tolerance),
    },
    Knob {
        key: "reuse.roughness",
        values: "0 to 1",
        help: "how much the roughness of neighbours may differ. More: more neighbours across materials, less alike; \
               less: fewer where roughness varies, so more noise there",
        set: |s, text| number(&mut s.roughness_tolerance, text, 0.0, 1.0),
        get: |s| text(s.roughness_tolerance),
    },
    Knob {
        key: "reuse.resolution",
        values: "full, checkerboard or half",
        help: "which pixels have reservoirs of full quality; the others offer few candidates of their own and reuse \
               those. full: all pixels, the least noise; checkerboard: every second one, faster; half: every fourth \
               one, the fastest, the most noise",
        set: |s, text| named(&mut s.lattice, text, LATTICES),
        get: |s| name_of(s.lattice, LATTICES),
    },
    Knob {
        key: "temporal.cap",
        values: "0 to 1000",
        help: "largest confidence of the frame before, in units of a fresh sample. More: less noise from one frame to \
               the next, but more of it shared by neighbours, and slower to follow; less: noise that changes from \
               frame to frame, quick to follow; 0: no history. Where nothing moves, the error of one frame hardly \
               changes between 5 and 30",
        set: |s, text| number(&mut s.confidence_cap, text, 0, 1000),
        get: |s| text(s.confidence_cap),
    },
    Knob {
        key: "temporal.neighbors",
        values: "0 to 6",
        help: "neighbours in the frame before, beside the pixel itself. More: less noise, more time; less: faster \
               frames",
        set: |s, text| number(&mut s.temporal_neighbors, text, 0, 6),
        get: |s| text(s.temporal_neighbors),
    },
    Knob {
        key: "temporal.neighbors_unseen",
        values: "0 to 12",
        help: "the same where the surface was not seen in the frame before. More: less noise where something has come \
               into view, more time there; less: faster, noise at such places until there is history",
        set: |s, text| number(&mut s.temporal_neighbors_unseen, text, 0, 12),
        get: |s| text(s.temporal_neighbors_unseen),
    },
    Knob {
        key: "spatial.rounds",
        values: "0 to 6",
        help: "rounds of spatial reuse in a frame of the real-time chain, after reuse in time. More: less noise a \
               frame, more time, more noise that neighbours share; less: faster frames; 0: the neighbours in the \
               frame before do as well",
        set: |s, text| number(&mut s.spatial_rounds, text, 0, MAX_ROUNDS),
        get: |s| text(s.spatial_rounds),
    },
    Knob {
        key: "spatial.neighbors",
        values: "0 to 12",
        help: "neighbours in each of these rounds. More: less noise, more time; less: faster frames",
        set: |s, text| number(&mut s.spatial_neighbors, text, 0, 12),
        get: |s| text(s.spatial_neighbors),
    },
    Knob {
        key: "spatial.neighbors_unseen",
        values: "0 to 12",
        help: "the same where a pixel has got nothing from the frame before. More: less noise where something has \
               come into view, more time there; less: faster, noise at such places",
        set: |s, text| number(&mut s.spatial_neighbors_unseen, text, 0, 12),
        get: |s| text(s.spatial_neighbors_unseen),
    },
    Knob {
        key: "still.rounds",
        values: "0 to 6",
        help: "rounds of spatial reuse in each frame of a still. More: less noise a frame, fewer frames in the same \
               time; less: more frames; 0: no reuse",
        set: |s, text| number(&mut s.still_rounds, text, 0, MAX_ROUNDS),
        get: |s| text(s.still_rounds),
    },
    Knob {
        key: "still.neighbors",
        values: "0 to 12",
        help: "neighbours in each of these rounds. More: less noise, more time; less: faster frames",
        set: |s, text| number(&mut s.still_neighbors, text, 0, 12),
        get: |s| text(s.still_neighbors),
    },
    Knob {
        key: "target.occlusion",
        values: "none or screen",
        help: "approximate occlusion in the target of candidates. none: no time for it; screen: a march through the \
               depth of the picture, fewer samples that turn out hidden, for some time; more noise where light passes \
               behind what is seen",
        set: |s, text| named(&mut s.occlusion, text, OCCLUSIONS),
        get: |s| name_of(s.occlusion, OCCLUSIONS),
    },
    Knob {
        key: "target.occlusion_reach",
        values: "1 to 256",
        help: "how far that march goes, in pixels. More: finds more, misses more between its steps; less: finds only \
               what is close by, but thin things too",
        set: |s, text| number(&mut s.occlusion_reach_px, text, 1.0, 256.0),
        get: |s| text(s.occlusion_reach_px),
    },
    Knob {
        key: "camera.jitter",
        values: "on or off",
        help: "camera rays. on: spread over the pixel, which smooths edges; off: through its center, so that what \
               differs between pictures is light alone",
        set: |s, text| named(&mut s.jitter, text, SWITCH),
        get: |s| name_of(s.jitter, SWITCH),
    },
    Knob {
        key: "camera.rays",
        values: "1 to 64",
        help: "camera rays of a pixel at the edges of what emits light and of the sky, and between surfaces whose light has \
               a closed form, as the frame before shows them; elsewhere there is one. More: less noise there; less: faster",
        set: |s, text| number(&mut s.camera_rays, text, 1, 64),
        get: |s| text(s.camera_rays),
    },
    Knob {
        key: "path.length",
        values: "1 to 64",
        help: "surfaces on a path, for `--integrator reference` only: 1 is direct light. More: light that has \
               bounced, more time and noise; less: darker, faster",
        set: |s, text| number(&mut s.path_length, text, 1, 64),
        get: |s| text(s.path_length),
    },
    Knob {
        key: "scene.time",
        values: "-1000000 to 1000000",
        help: "the moment of an animated scene, in seconds. More: a later one; less: an earlier one",
        set: |s, text| number(&mut s.time_s, text, -1e6, 1e6),
        get: |s| text(s.time_s),
    },
    Knob {
        key: "scene.time_step",
        values: "0 to 1000",
        help: "seconds from one frame of the real-time chain to the next. More: faster motion, less of the frame \
               before to reuse; less: slower motion; 0: none",
        set: |s, text| number(&mut s.time_step_s, text, 0.0, 1000.0),
        get: |s| text(s.time_step_s),
    },
    skip!("absent", Absent, "passes for lights or emitters, where the scene has none"),
    skip!("unread", Unread, "passes whose results nothing reads, and their memory"),
    skip!("textures", Textures, "code for images, where no material has any"),
    skip!("masks", Masks, "code for alpha masks, where no material has any"),
    skip!("emission_images", EmissionImages, "code for images of what emits, where nothing that emits has any"),
    skip!("environment", Environment, "code for lights other than triangles, where there are none"),
    skip!("instances", Instances, "code for the space of instances, where there is one, in place"),
    skip!("specular", Specular, "code for specular lobes, where every material is Lambert's"),
    skip!("few", Few, "drawing lights, where each can be a candidate"),
    skip!(
        "presampling",
        Presampling,
        "tiles, where there are no more lights than a tile has records: they are drawn by power then"
    ),
    skip!("horizon", Horizon, "lights in cuts that lie below the horizon of all surfaces in a block of 8x8 pixels"),
    skip!(
        "closed_form",
        ClosedForm,
        "sampling, where each of few lights is seen whole or not at all by a matte surface"
    ),
    skip!("known", Known, "shadow rays to samples that are known to be visible"),
    skip!("black", Black, "candidates and rays by the BSDF, where a surface reflects nothing"),
    skip!("unlit", Unlit, "shadow rays of reuse to lights that face away, or that the surface faces away from"),
    skip!("trees", Trees, "light trees, where no candidate comes down one"),
    skip!("updates", Updates, "light tables, trees and uploads for a frame that shows the moment of the last"),
    skip!(
        "still",
        Still,
        "the same for what stands still: places, tables and trees over lights that have not changed, top level and uploads"
    ),
    skip!("primary", Primary, "camera rays of a frame that sees what the last two have seen, with `camera.jitter=off`"),
    skip!("tiles", Tiles, "tiles of 8x8 pixels, or more, in which no pixel has light to sample"),
];
