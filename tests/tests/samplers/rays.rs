//! Rays by the BSDF: what they find, against the density that candidates reckon with.

use weir_shader::bsdf_rays::bsdf_rays;
use weir_tests::statistics::misfit;

use crate::cells::{Bench, PX};

const RAYS: u32 = 1_000_000;

/// How often rays end in each cell, and last in none.
fn found(bench: &Bench, cells: usize) -> Vec<f64> {
    let mut counts = vec![0.0; cells + 1];
    let bvh = &bench.packed.bvh;
    for i in 0..RAYS {
        let frame = bench.frame(i);
        let hit = if bench.has_others() {
            bsdf_rays::<false, true, true>(PX, 0, &frame, &bench.view(), bvh.as_slice(), &bench.surfaces)
        } else {
            bsdf_rays::<false, false, true>(PX, 0, &frame, &bench.view(), bvh.as_slice(), &bench.surfaces)
        };
        counts[if hit.has_sample() { bench.cell_of(hit.light, hit.uv) } else { cells }] += 1.0;
    }
    counts
}

#[test]
fn rays_by_the_bsdf_end_where_its_density_says() {
    for sky in [false, true] {
        for (specular, roughness) in [(0.0, 1.0), (0.3, 0.5), (0.9, 0.3)] {
            let bench = Bench::new(sky, specular, roughness);
            let cells = bench.cells();
            let observed = found(&bench, cells.len());
            // With a sky every ray finds something; the edges of lamps before it leave the integral a little off.
            let sum: f64 = cells.iter().map(|c| c.bsdf).sum();
            assert!(sum < 1.001, "{sum}");
            let scale = f64::from(RAYS) / sum.max(1.0);
            let share = |wrong: f64| {
                let mut expected: Vec<f64> = cells.iter().map(|c| c.bsdf * scale).collect();
                let lamps = 4 * bench.packed.frame.light_count as usize;
                expected[..lamps].iter_mut().for_each(|e| *e *= wrong);
                expected.push((f64::from(RAYS) - expected.iter().sum::<f64>()).max(0.0));
                misfit(&observed, &expected)
            };
            let name = format!("sky {sky}, specular {specular}, roughness {roughness}");
            assert!(share(1.0) < 1.0, "{name}: {}", share(1.0));
            // Teeth.
            assert!(share(1.1) > 1.0, "{name}: a wrong density is not seen");
        }
    }
}
