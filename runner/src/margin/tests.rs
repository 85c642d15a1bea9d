use rand_pcg::{
    Pcg64Mcg,
    rand_core::{Rng, SeedableRng},
};

use super::*;

const PIXELS: usize = 400;

fn uniform(rng: &mut Pcg64Mcg) -> f64 {
    (rng.next_u64() >> 11) as f64 / (1u64 << 53) as f64
}

/// A picture whose true values are known, from frames in which blocks of pixels share their noise.
struct Synthetic {
    truth: Vec<[f64; 3]>,
    moments: Vec<PixelMoments>,
    batches: Batches,
    frames: u32,
}

impl Synthetic {
    fn new(frames: u32, block: usize, rng: &mut Pcg64Mcg) -> Self {
        let truth: Vec<[f64; 3]> = (0..PIXELS).map(|p| [0.5 + (p % 7) as f64, 1.0, 0.2 + (p % 3) as f64]).collect();
        let mut moments = vec![PixelMoments::default(); PIXELS];
        let mut batches = Batches::new(PIXELS, None);
        for frame in 1..=frames {
            let shared: Vec<f64> = (0..PIXELS.div_ceil(block)).map(|_| uniform(rng)).collect();
            for (p, moment) in moments.iter_mut().enumerate() {
                // The mean of 3 u^2 is 1; it is skewed, as light is.
                let value = truth[p].map(|t| t * 3.0 * shared[p / block].powi(2));
                *moment = moment.merged(f64::from(frame - 1), &PixelMoments { mean: value, ..Default::default() }, 1.0);
            }
            if batches.due_in(frame) == 0 {
                batches.add(frame, |p| moments[p]);
            }
        }
        Self { truth, moments, batches, frames }
    }

    fn margin(&self) -> Margin {
        self.batches.margin(self.frames, &self.moments).expect("two batches")
    }

    /// Root of relMSE against the truth.
    fn error(&self) -> f64 {
        let mean = self.truth.iter().flatten().sum::<f64>() / (3 * PIXELS) as f64;
        let values = self.moments.iter().flat_map(|m| m.mean).zip(self.truth.iter().flatten());
        let squares = values.map(|(x, r)| (x - r).powi(2) / (r * r + FLOOR * mean * mean));
        (squares.sum::<f64>() / (3 * PIXELS) as f64).sqrt()
    }
}

/// Share of pictures whose true error lies within the interval.
fn coverage(frames: u32, block: usize, width_factor: impl Fn(&Margin) -> f64) -> f64 {
    let trials = 1000;
    let inside = (0..trials).filter(|seed| {
        let picture = Synthetic::new(frames, block, &mut Pcg64Mcg::seed_from_u64(*seed));
        let (margin, error) = (picture.margin(), picture.error());
        let factor = width_factor(&margin);
        let [low, high] = [margin.low, margin.high].map(|end| margin.error + factor * (end - margin.error));
        (low..=high).contains(&error)
    });
    inside.count() as f64 / trials as f64
}

#[test]
fn nineteen_intervals_in_twenty_hold_the_true_error_however_many_pixels_share_their_noise() {
    for (frames, block) in [(64, 1), (64, 4), (61, 20), (200, 10), (16, 2)] {
        let share = coverage(frames, block, |_| 1.0);
        println!("{frames} frames, noise shared by {block}: {:.1} %", 100.0 * share);
        assert!((0.92..=0.985).contains(&share), "{frames} frames, noise shared by {block} pixels: {share}");
    }
}

/// What an interval would be that took pixels for independent: narrower by the root of how many share their noise.
#[test]
fn an_interval_for_independent_pixels_holds_the_error_too_rarely_where_they_are_not() {
    let share = coverage(64, 20, |_| 1.0 / 20f64.sqrt());
    assert!(share < 0.5, "{share}");
}

#[test]
fn batches_give_back_the_frames_they_were_made_of() {
    let mut rng = Pcg64Mcg::seed_from_u64(5);
    let picture = Synthetic::new(100, 1, &mut rng);
    // 100 frames: pairs became one at 16, 32 and 64 frames, so batches have 8 each, and 12 of them fit.
    assert_eq!((picture.batches.stride, picture.batches.batches.len()), (8, 12));
    let mut all = PixelMoments::default();
    for (i, batch) in picture.batches.batches.iter().enumerate() {
        all = all.merged(8.0 * i as f64, &batch[17], 8.0);
    }
    let expected = picture.batches.so_far[17];
    for c in 0..3 {
        assert!((all.mean[c] - expected.mean[c]).abs() < 1e-12);
        assert!((all.deviation[c] - expected.deviation[c]).abs() < 1e-9);
    }
}

#[test]
fn a_known_number_of_frames_is_looked_at_sixteen_times_at_most() {
    for frames in [1, 2, 5, 16, 17, 64, 1000] {
        let mut batches = Batches::new(1, Some(frames));
        let (mut looks, mut n) = (0, 0);
        while n < frames {
            n += batches.due_in(n).min(frames - n);
            if batches.due_in(n) == 0 {
                batches.add(n, |_| PixelMoments { mean: [f64::from(n); 3], deviation: [1.0; 3] });
                looks += 1;
            }
        }
        assert!(looks <= 16, "{frames} frames: {looks} looks");
        assert_eq!(batches.margin(frames, &[PixelMoments::default()]).is_some(), frames > 1, "{frames} frames");
    }
}

#[test]
fn a_large_picture_is_looked_at_in_many_places() {
    let pixels = 1_000_003;
    let batches = Batches::new(pixels, None);
    assert_eq!(batches.pixels.len(), MOST_PIXELS);
    let mut sorted = batches.pixels.clone();
    sorted.sort_unstable();
    sorted.dedup();
    assert!(sorted.len() > MOST_PIXELS * 99 / 100 && sorted.iter().all(|&p| p < pixels));
    let widest = sorted.windows(2).map(|pair| pair[1] - pair[0]).max().expect("pixels");
    assert!(widest < 4 * pixels / MOST_PIXELS, "{widest}");
}

#[test]
fn a_black_picture_has_no_error() {
    let mut batches = Batches::new(4, Some(4));
    (1..=4).for_each(|n| batches.add(n, |_| PixelMoments::default()));
    let margin = batches.margin(4, &[PixelMoments::default(); 4]).expect("four batches");
    assert_eq!((margin.error, margin.low, margin.high), (0.0, 0.0, 0.0));
    assert_eq!(frames_for(0.01, &margin, 4), 2.0);
}

#[test]
fn the_sentence_has_as_many_digits_as_the_margin_deserves() {
    let margin = |error, low, high| Margin { error, low, high, variance_spread: 0.0 }.to_string();
    assert_eq!(margin(0.0213, 0.0193, 0.0233), "mean relative error 2.13 % +- 0.20 %, 95 % confidence");
    assert_eq!(margin(0.3, 0.25, 0.35), "mean relative error 30.0 % +- 5.0 %, 95 % confidence");
    assert_eq!(margin(0.0, 0.0, 0.0), "mean relative error 0.0 % +- 0.0 %, 95 % confidence");
}

#[test]
fn quantiles_are_those_of_tables() {
    for (freedom, expected) in [(1.0, 12.706_205), (4.0, 2.776_445), (15.0, 2.131_450), (100.0, 1.983_972)] {
        assert!((student(freedom) - expected).abs() < 1e-4, "{freedom}: {}", student(freedom));
    }
}
