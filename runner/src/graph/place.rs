//! Memory for the steps that run.

use std::collections::{BTreeMap, BTreeSet};

use weir_shader::wiring::Access;

use super::{Culled, Facts, History, Life, Live, Plan, Planned, Resource, Slot};

/// First and last step that uses a transient.
#[derive(Clone, Copy)]
struct Span {
    first: usize,
    last: usize,
}

/// Gives every binding its memory. Transients share a buffer where their spans do not meet, first fit.
pub(super) fn place(
    live: &[Live],
    culled: Vec<(&'static str, Culled)>,
    resources: &[Resource],
    facts: &Facts,
    outputs: &[&'static str],
) -> Plan {
    let pixels = u64::from(facts.width) * u64::from(facts.height);
    let find = |name: &str| resources.iter().find(|r| r.name == name).expect("names were checked");
    let written: BTreeSet<&str> = live
        .iter()
        .flat_map(|l| l.pass.bindings.iter().filter(|b| b.access == Access::Write).map(|b| b.name))
        .collect();

    let mut spans: BTreeMap<&'static str, Span> = BTreeMap::new();
    for (i, step) in live.iter().enumerate() {
        for binding in step.pass.bindings.iter().filter(|b| written.contains(b.name)) {
            if find(binding.name).life == Life::Transient {
                spans.entry(binding.name).or_insert(Span { first: i, last: i }).last = i;
            }
        }
    }
    // Outputs are read after the last step.
    for name in outputs {
        if let Some(span) = spans.get_mut(name) {
            span.last = live.len();
        }
    }

    let mut pool: Vec<(u64, usize)> = Vec::new();
    let mut pool_of: BTreeMap<&str, usize> = BTreeMap::new();
    let mut order: Vec<_> = spans.iter().collect();
    order.sort_by_key(|(name, span)| (span.first, **name));
    for (name, span) in order {
        let bytes = find(name).stride as u64 * pixels;
        let index = match pool.iter().position(|&(_, busy_until)| busy_until < span.first) {
            Some(index) => index,
            None => {
                pool.push((0, 0));
                pool.len() - 1
            }
        };
        pool[index] = (pool[index].0.max(bytes), span.last);
        pool_of.insert(name, index);
    }

    let history: Vec<History> = resources
        .iter()
        .filter(|r| r.life == Life::History && written.contains(r.name))
        .map(|r| History { name: r.name, bytes: r.stride as u64 * pixels })
        .collect();
    let doubled = |name: &str| history.iter().position(|h| h.name == name);

    let mut zero_bytes = 0;
    let mut slot = |name: &'static str| {
        let (base, previous) = match name.strip_prefix("prev_") {
            Some(base) => (base, true),
            None => (name, false),
        };
        let resource = find(base);
        let found = match resource.life {
            Life::Scene => Some(Slot::Scene(resource.name)),
            Life::History => doubled(base).map(|i| if previous { Slot::Previous(i) } else { Slot::Current(i) }),
            Life::Transient => pool_of.get(base).map(|&i| Slot::Pool(i)),
        };
        found.unwrap_or_else(|| {
            zero_bytes = zero_bytes.max(resource.stride as u64 * pixels);
            Slot::Zero
        })
    };
    let steps = live
        .iter()
        .map(|l| Planned {
            pass: l.pass,
            variant: l.variant,
            slots: l.pass.bindings.iter().map(|b| (b.access, slot(b.name))).collect(),
        })
        .collect();
    let outputs = outputs.iter().map(|&name| (name, slot(name))).collect();
    let pool = pool.into_iter().map(|(bytes, _)| bytes).collect();
    Plan { steps, culled, history, pool, zero_bytes, outputs, facts: facts.clone() }
}
