//! Cases about streams of weights.

use weir_shared::{
    fault,
    numerics::unit_float,
    resample::{Chooser, NOT_KEPT, Stream, WithoutReplacement, choice},
    reservoir::Reservoir,
    rng::Rng,
};

use super::{Finding, statistics::misfit};

const WAYS: [u32; 3] = [choice::THRESHOLD, choice::PLAIN, choice::KEYS];

/// What came of a stream.
struct Ended {
    kept: usize,
    ucw: f32,
    fault: u32,
}

/// No item.
const NONE: usize = usize::MAX;

fn offered(items: &[(f32, f32)], way: u32, rng: Rng) -> Ended {
    let mut stream = Stream::new(NONE, Chooser::new(rng, way));
    for (i, &(target, weight)) in items.iter().enumerate() {
        stream.offer(i, target, weight);
    }
    Ended { kept: stream.kept(), ucw: stream.contribution_weight(), fault: stream.fault() }
}

/// Streams of all ways, each with several seeds.
fn on_each_way(items: &[(f32, f32)], seeds: u32) -> impl Iterator<Item = Ended> {
    WAYS.into_iter().flat_map(move |way| {
        let run = move |seed| offered(items, way, Rng::from_words(seed, 11, way, 0));
        (0..seeds).map(run).collect::<Vec<_>>()
    })
}

/// Units in the last place between two positive numbers.
pub fn ulps(a: f32, b: f32) -> u32 {
    a.to_bits().abs_diff(b.to_bits())
}

pub fn all_zero() -> Finding {
    let held: Vec<Ended> = on_each_way(&[(1.0, 0.0); 32], 100).collect();
    let reservoir = Reservoir::new(0, 0, held[0].ucw, 1);
    let holds = held.iter().all(|e| e.kept == NONE && e.ucw == 0.0 && e.fault == fault::NONE);
    let empty = !reservoir.has_sample() && reservoir.confidence() == 1;
    Finding::new(
        holds && empty,
        format!("W = {}, c = {}, fault {}", held[0].ucw, reservoir.confidence(), held[0].fault),
    )
}

pub fn one_positive() -> Finding {
    let (mut wrong, mut worst) = (0, 0);
    for place in 0..32 {
        let mut items = [(1.0, 0.0); 32];
        items[place] = (0.3, 0.7);
        for ended in on_each_way(&items, 100) {
            wrong += u32::from(ended.kept != place || ended.fault != fault::NONE);
            worst = worst.max(ulps(ended.ucw, 0.7 / 0.3));
        }
    }
    Finding::new(wrong == 0 && worst <= 2, format!("{wrong} of 9600 streams kept another; W within {worst} ulp"))
}

/// Finds that the weight is dropped and named, and that the sum is that of the others.
fn dropped(weight: f32, kind: u32) -> Finding {
    let [mut wrong, mut uncounted, mut streams] = [0; 3];
    for place in 0..3 {
        let mut items = vec![(1.0, 1.0), (2.0, 2.0)];
        items.insert(place, (1.0, weight));
        for ended in on_each_way(&items, 200) {
            streams += 1;
            let target = if ended.kept == NONE { 0.0 } else { items[ended.kept].0 };
            wrong += u32::from(ended.kept == place || ended.ucw * target != 3.0);
            uncounted += u32::from(ended.fault != kind);
        }
    }
    let text = format!("of {streams} streams {wrong} with another sum than 3, {uncounted} not counted as such");
    Finding::new(wrong + uncounted == 0, text)
}

pub fn infinite() -> Finding {
    dropped(f32::INFINITY, fault::INFINITE)
}

pub fn not_a_number() -> Finding {
    dropped(f32::NAN, fault::NOT_A_NUMBER)
}

/// The stream of random numbers whose first number has the given upper 24 bits.
fn rng_starting_with(bits: u32) -> Rng {
    let starts_so = |seed: &u32| Rng::from_words(*seed, 0, 0, 0).next_word() >> 8 == bits;
    let seed = (0..u32::MAX).find(starts_so).expect("one of 2^32 hashes");
    Rng::from_words(seed, 0, 0, 0)
}

pub fn extreme_random_numbers() -> Finding {
    let (least, most) = (rng_starting_with(0), rng_starting_with(0xff_ffff));
    let numbers = [least, most].map(|mut rng| unit_float(rng.next_word()));
    let sets: [&[f32]; 4] = [&[0.0, 1.0], &[0.0, 0.1, 0.0], &[0.1; 32], &[0.0, 3e-39, 1e38, 0.7, 0.0]];
    let (mut wrong, mut streams) = (0, 0);
    for weights in sets {
        let items: Vec<(f32, f32)> = weights.iter().map(|&w| (1.0, w)).collect();
        for way in WAYS {
            for rng in [least, most] {
                let ended = offered(&items, way, rng);
                streams += 1;
                wrong += u32::from(weights.get(ended.kept).is_none_or(|&w| w == 0.0) || ended.fault != fault::NONE);
            }
        }
    }
    let text = format!(
        "u = {:e} and 1 - {:e}: {wrong} of {streams} streams kept no or a zero weight",
        numbers[0],
        1.0 - numbers[1]
    );
    Finding::new(wrong == 0 && numbers[0] == 0.0 && numbers[1] < 1.0, text)
}

pub fn sixty_decades() -> Finding {
    let (mut wrong, mut streams, mut faults) = (0, 0, 0);
    for weights in [[1e-30, 1e30], [1e30, 1e-30], [1e-38, 2e38], [2e38, 1e-38]] {
        let large = usize::from(weights[1] > 1.0);
        for ended in on_each_way(&weights.map(|w| (1.0, w)), 1000) {
            streams += 1;
            wrong += u32::from(ended.kept != large || ended.ucw != weights[large]);
            faults += u32::from(ended.fault != fault::NONE);
        }
    }
    Finding::new(wrong + faults == 0, format!("{wrong} of {streams} streams lost the large weight, {faults} faults"))
}

pub fn denormals() -> Finding {
    let (mut kept, mut zero, mut wrong) = (0, 0, 0);
    for target in [1e-40, 1.0] {
        for ended in on_each_way(&[(target, 1e-40); 8], 1000) {
            // Either all are taken for zeros, or their sum counts.
            let sum = ended.ucw * target;
            let is_kept = ended.kept != NONE && sum.is_finite() && (sum / 8e-40 - 1.0).abs() < 1e-3;
            let is_zero = ended.ucw == 0.0;
            kept += u32::from(is_kept);
            zero += u32::from(is_zero);
            wrong += u32::from(!is_kept && !is_zero || ended.fault != fault::NONE);
        }
    }
    Finding::new(
        wrong == 0 && (kept == 0 || zero == 0),
        format!("{kept} kept with a finite W, {zero} as zero, {wrong} wrong"),
    )
}

pub fn overflowing_weight() -> Finding {
    let finite = offered(&[(1e-38, 1.0)], choice::PLAIN, Rng::from_words(0, 0, 0, 0));
    let over = offered(&[(1e-39, 1.0)], choice::PLAIN, Rng::from_words(0, 0, 0, 0));
    let emptied = !Reservoir::new(0, 0, over.ucw, 1).has_sample() && over.fault == fault::OVERFLOW;
    let kept = (finite.ucw / 1e38 - 1.0).abs() < 1e-6 && finite.fault == fault::NONE;
    // The light that is lost is f W = f S / p; with f = p that is S.
    let text = format!(
        "W = {:e} kept; beyond, W = {}, `{}`, a loss of S f / p = 1 is told",
        finite.ucw,
        over.ucw,
        fault::KINDS[1]
    );
    Finding::new(emptied && kept, text)
}

/// Every order of four weights; the statistic as a share of what noise allows.
pub fn orders() -> Finding {
    const WEIGHTS: [f32; 4] = [1.0, 0.25, 3.0, 0.75];
    let mut worst = 0.0f64;
    let mut count = 0u32;
    for way in WAYS {
        for order in 0..24usize {
            let mut left = vec![0, 1, 2, 3];
            let order: [usize; 4] = [order / 6, order / 2 % 3, order % 2, 0].map(|i| left.remove(i));
            let mut counts = [0.0; 4];
            let items = order.map(|i| (1.0, WEIGHTS[i]));
            for seed in 0..10_000 {
                counts[order[offered(&items, way, Rng::from_words(seed, count, way, 5)).kept]] += 1.0;
            }
            worst = worst.max(misfit(&counts, &WEIGHTS.map(|w| f64::from(w) / 5.0 * 10_000.0)));
            count += 1;
        }
    }
    Finding::new(worst < 1.0, format!("worst of {count} laws at {worst:.2} of the chi-square that noise allows"))
}

pub fn many_equal() -> Finding {
    const ITEMS: usize = 4096;
    let mut worst = 0.0f64;
    for way in WAYS {
        let mut counts = vec![0.0; ITEMS];
        for seed in 0..(ITEMS as u32 * 10) {
            counts[offered(&[(1.0, 1.0); ITEMS], way, Rng::from_words(seed, 3, way, 1)).kept] += 1.0;
        }
        worst = worst.max(misfit(&counts, &[10.0; ITEMS]));
    }
    Finding::new(worst < 1.0, format!("chi-square over 4096 cells at {worst:.2} of what noise allows"))
}

pub fn keys() -> Finding {
    let weights = [1e-20f32, 1e20, 1e-20, 1e20, 1e-20];
    let draws = 2000;
    let (mut wrong, mut unguarded) = (0, 0);
    for draw in 0..draws {
        // The first number is zero now and then.
        let mut rng = Rng::from_words(draw, 2, 9, 0);
        let mut kept = WithoutReplacement::new(2);
        let mut places = [NONE; 2];
        for (i, &weight) in weights.iter().enumerate() {
            let random = if draw % 4 == 0 { 0.0 } else { rng.next_float() };
            let place = kept.offer(weight, random);
            if place != NOT_KEPT {
                places[place as usize] = i;
            }
        }
        places.sort_unstable();
        wrong += u32::from(places != [1, 3]);
        let keys = [0, 1].map(|place| kept.key(place));
        unguarded += u32::from(!keys.iter().all(|k| k.is_finite()));
    }
    let one = on_each_way(&weights.map(|w| (1.0, w)), 2000).filter(|e| e.kept != 1 && e.kept != 3).count();
    let text =
        format!("{wrong} of {draws} draws and {one} of 6000 streams kept a light one; {unguarded} keys not finite");
    Finding::new(wrong + unguarded == 0 && one == 0, text)
}
