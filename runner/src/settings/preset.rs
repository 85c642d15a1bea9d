//! Settings that go together.

use weir_shared::{light::source, merge::form, resample::choice, reuse::lattice, reuse::rule, target::occlusion};

use super::{Rays, Settings};
use crate::{executor::gpu::Traversal, packed::TreeUpdate, skips::Skips};

/// Settings that go together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Preset {
    /// One shadow ray a pixel.
    Fast,
    /// One ray by the BSDF; in real time at most three shadow rays.
    Balanced,
    /// One ray by the BSDF; visibility in the target of every input.
    Quality,
    /// What the first paper on this used.
    Paper,
}

impl Preset {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Fast, Self::Balanced, Self::Quality, Self::Paper];

    /// As `--set preset=` takes it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Fast => "fast",
            Self::Balanced => "balanced",
            Self::Quality => "quality",
            Self::Paper => "paper",
        }
    }

    /// Its settings.
    pub fn settings(self) -> Settings {
        let balanced = Settings {
            candidates: 4,
            source: source::POWER,
            candidates_tree: 3,
            tree_update: TreeUpdate::Rebuild,
            tile_count: 128,
            tile_size: 1024,
            cell_size: 0.02,
            cell_slots: 32,
            cell_candidates: 8,
            cut_size: 8,
            candidates_bsdf: 1,
            candidates_full: 0,
            candidates_off_lattice: 2,
            reservoirs: 1,
            choice: choice::THRESHOLD,
            mis_form: form::PAIRWISE_DEFENSIVE,
            rays: Rays::Balanced,
            traversal: Traversal::Auto,
            sum: true,
            confidence_cap: 8,
            temporal_neighbors: 3,
            temporal_neighbors_unseen: 6,
            spatial_rounds: 0,
            spatial_neighbors: 3,
            spatial_neighbors_unseen: 6,
            still_rounds: 3,
            still_neighbors: 6,
            radius_px: 10.0,
            neighbor_rule: rule::DISK,
            normal_angle_deg: 25.0,
            plane_tolerance: 0.02,
            roughness_tolerance: 0.25,
            occlusion: occlusion::NONE,
            occlusion_reach_px: 24.0,
            lattice: lattice::FULL,
            jitter: true,
            camera_rays: 4,
            path_length: 1,
            time_s: 0.0,
            time_step_s: 1.0 / 60.0,
            skips: Skips::default(),
        };
        match self {
            Self::Balanced => balanced,
            Self::Fast => {
                Settings { rays: Rays::Speed, candidates_bsdf: 0, temporal_neighbors: 1, still_rounds: 1, ..balanced }
            }
            Self::Quality => Settings {
                candidates: 8,
                candidates_tree: 6,
                rays: Rays::Quality,
                spatial_rounds: 1,
                still_rounds: 2,
                ..balanced
            },
            // Section 5 there, unbiased: 32 candidates, one round of three neighbours within 30 pixels, a history of
            // twenty frames, no neighbours in the frame before.
            Self::Paper => Settings {
                candidates: 32,
                candidates_tree: 0,
                candidates_bsdf: 0,
                rays: Rays::Quality,
                sum: false,
                confidence_cap: 20,
                temporal_neighbors: 0,
                temporal_neighbors_unseen: 0,
                spatial_rounds: 1,
                spatial_neighbors: 3,
                spatial_neighbors_unseen: 3,
                still_rounds: 1,
                still_neighbors: 3,
                radius_px: 30.0,
                ..balanced
            },
        }
    }
}
