//! A part of a module: some of its entry points, and what they call.

use std::collections::{HashMap, HashSet};

const HEADER_WORDS: usize = 5;

/// Numbers of the instructions that matter here, as the SPIR-V specification has them.
mod op {
    pub const NAME: u16 = 5;
    pub const ENTRY_POINT: u16 = 15;
    pub const EXECUTION_MODE: u16 = 16;
    pub const FUNCTION: u16 = 54;
    pub const FUNCTION_END: u16 = 56;
    pub const FUNCTION_CALL: u16 = 57;
    pub const DECORATE: u16 = 71;
}

/// The decoration of a float operation that is rounded for itself.
const NO_CONTRACTION: u32 = 42;

/// All instructions of a module.
fn instructions(module: &[u32]) -> impl Iterator<Item = (usize, &[u32])> {
    instructions_from(module, HEADER_WORDS)
}

/// Instructions from word `at` on: where each starts, and all of its words.
fn instructions_from(module: &[u32], mut at: usize) -> impl Iterator<Item = (usize, &[u32])> {
    std::iter::from_fn(move || {
        let length = (*module.get(at)? >> 16) as usize;
        let words = module.get(at..at + length).filter(|words| !words.is_empty())?;
        at += length;
        Some((at - length, words))
    })
}

fn opcode(words: &[u32]) -> u16 {
    words[0] as u16
}

/// A literal string at the start of `words`, without its end.
fn string(words: &[u32]) -> Vec<u8> {
    words.iter().flat_map(|word| word.to_le_bytes()).take_while(|byte| *byte != 0).collect()
}

/// A function: where its words are, and what it calls.
struct Function {
    start: usize,
    end: usize,
    calls: Vec<u32>,
}

fn functions(module: &[u32]) -> HashMap<u32, Function> {
    let mut functions = HashMap::new();
    let mut open: Option<(u32, Function)> = None;
    for (at, words) in instructions(module) {
        match (opcode(words), &mut open) {
            (op::FUNCTION, _) => open = Some((words[2], Function { start: at, end: at, calls: Vec::new() })),
            (op::FUNCTION_CALL, Some((_, function))) => function.calls.push(words[3]),
            (op::FUNCTION_END, _) => {
                if let Some((id, function)) = open.take() {
                    functions.insert(id, Function { end: at + words.len(), ..function });
                }
            }
            _ => {}
        }
    }
    functions
}

/// The module with no other entry points than those named, and no other functions than those they call. What remains is
/// word for word what it was, so that it computes the same.
pub fn only(module: &[u32], entry_points: &[&str]) -> Vec<u32> {
    let functions = functions(module);
    let named = |words: &[u32]| entry_points.iter().any(|name| name.as_bytes() == string(&words[3..]));
    let is_wanted = |words: &&[u32]| opcode(words) == op::ENTRY_POINT && named(words);
    let roots: Vec<u32> =
        instructions(module).map(|(_, words)| words).filter(is_wanted).map(|words| words[2]).collect();
    let mut kept = HashSet::new();
    let mut to_visit = roots.clone();
    while let Some(id) = to_visit.pop() {
        if kept.insert(id) {
            to_visit.extend(functions.get(&id).into_iter().flat_map(|function| &function.calls));
        }
    }
    let mut bodies: Vec<&Function> = kept.iter().filter_map(|id| functions.get(id)).collect();
    bodies.sort_by_key(|function| function.start);
    // Operations with a result name it third. Only those are decorated within functions, with NoContraction.
    let mut computed = HashSet::new();
    for function in &bodies {
        let body = instructions_from(&module[..function.end], function.start);
        computed.extend(body.filter_map(|(_, words)| words.get(2).copied()));
    }

    let mut part = module[..HEADER_WORDS.min(module.len())].to_vec();
    for (_, words) in instructions(module).take_while(|(_, words)| opcode(words) != op::FUNCTION) {
        let stays = match opcode(words) {
            op::ENTRY_POINT => named(words),
            op::EXECUTION_MODE => roots.contains(&words[1]),
            op::DECORATE if words[2] == NO_CONTRACTION => computed.contains(&words[1]),
            op::NAME => false,
            _ => true,
        };
        if stays {
            part.extend_from_slice(words);
        }
    }
    for function in bodies {
        part.extend_from_slice(&module[function.start..function.end]);
    }
    part
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Entry points of a module, by name.
    fn names(module: &[u32]) -> Vec<String> {
        let entries = instructions(module).map(|(_, words)| words).filter(|words| opcode(words) == op::ENTRY_POINT);
        entries.map(|words| String::from_utf8(string(&words[3..])).expect("a name")).collect()
    }

    #[test]
    fn a_part_has_the_entry_points_asked_for_and_every_function_they_call() {
        for module in [crate::shaders::plain(), crate::shaders::strict()] {
            let all = names(&module);
            assert!(all.len() > 50);
            let wanted = [all[3].as_str(), all[0].as_str()];
            let part = only(&module, &wanted);
            assert_eq!(names(&part), [all[0].clone(), all[3].clone()]);
            assert!(part.len() * 5 < module.len(), "{} of {} words", part.len(), module.len());
            let (whole, kept) = (functions(&module), functions(&part));
            assert!(kept.len() < whole.len());
            for (id, function) in &kept {
                assert!(function.calls.iter().all(|called| kept.contains_key(called)));
                let before = &whole[id];
                assert_eq!(part[function.start..function.end], module[before.start..before.end]);
            }
        }
    }

    #[test]
    fn operations_that_must_not_be_contracted_stay_so() {
        let module = crate::shaders::strict();
        let part = only(&module, &[names(&module)[0].as_str()]);
        let pinned = |module: &[u32]| {
            let all = instructions(module).map(|(_, words)| words);
            all.filter(|words| opcode(words) == op::DECORATE && words[2] == NO_CONTRACTION).count()
        };
        assert!(pinned(&part) > 0 && pinned(&part) < pinned(&module));
    }
}
