//! Memory for the steps that run.

use std::collections::{BTreeMap, BTreeSet};

use weir_shader::wiring::Access;

use super::{Culled, Facts, History, Life, Live, Plan, Planned, Resource, Slot, Use};

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
    let find = |name: &str| resources.iter().find(|r| r.name == name).expect("names were checked");
    let written: BTreeSet<&str> = live.iter().flat_map(|l| l.resolved.names(Access::Write)).collect();

    // History that nobody asks for is a transient like others.
    let remembered: BTreeSet<&str> = live
        .iter()
        .flat_map(|l| l.resolved.uses.iter().filter(|u| u.previous && !u.ignored && written.contains(u.resource.name)))
        .map(|u| u.resource.name)
        .collect();
    let is_transient = |r: &Resource| match r.life {
        Life::Scene => false,
        Life::Transient => true,
        Life::History => !remembered.contains(r.name),
    };

    let mut spans: BTreeMap<&'static str, Span> = BTreeMap::new();
    for (i, step) in live.iter().enumerate() {
        for Use { resource, .. } in
            step.resolved.uses.iter().filter(|u| !u.ignored && written.contains(u.resource.name))
        {
            if is_transient(resource) {
                spans.entry(resource.name).or_insert(Span { first: i, last: i }).last = i;
            }
        }
    }
    // What is kept is read in the next frame as well.
    for name in live.iter().filter(|l| l.is_kept).flat_map(|l| l.resolved.names(Access::Write)) {
        if let Some(span) = spans.get_mut(name) {
            *span = Span { first: 0, last: live.len() };
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
        let bytes = find(name).bytes(facts);
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
        .filter(|r| remembered.contains(r.name))
        .map(|r| History { name: r.name, bytes: r.bytes(facts) })
        .collect();
    let doubled = |name: &str| history.iter().position(|h| h.name == name);

    let mut zero_bytes = 0;
    let mut slot = |resource: &Resource, previous: bool, ignored: bool| {
        let found = match resource.life {
            _ if ignored => None,
            Life::Scene => Some(Slot::Scene(resource.name)),
            Life::History if !is_transient(resource) => {
                doubled(resource.name).map(|i| if previous { Slot::Previous(i) } else { Slot::Current(i) })
            }
            Life::Transient | Life::History if !previous => pool_of.get(resource.name).map(|&i| Slot::Pool(i)),
            Life::Transient | Life::History => None,
        };
        found.unwrap_or_else(|| {
            zero_bytes = zero_bytes.max(if ignored { resource.stride as u64 } else { resource.bytes(facts) });
            Slot::Zero
        })
    };
    let steps = live
        .iter()
        .map(|l| Planned {
            pass: l.resolved.pass,
            variant: l.variant,
            slots: l.resolved.uses.iter().map(|u| (u.access, slot(&u.resource, u.previous, u.ignored))).collect(),
            names: l.resolved.uses.iter().map(|u| u.name).collect(),
            round: l.round,
            is_kept: l.is_kept,
        })
        .collect();
    let outputs = outputs.iter().map(|&name| (name, slot(find(name), false, false))).collect();
    let pool = pool.into_iter().map(|(bytes, _)| bytes).collect();
    Plan { steps, culled, history, pool, zero_bytes, outputs, facts: facts.clone() }
}
