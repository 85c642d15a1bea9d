//! Material libraries (Wavefront MTL), made safe for `tobj` and then read with it.
//!
//! `tobj` panics on colours with one or two components and gives up a whole library for one odd line. Here each
//! statement is checked, completed or dropped by itself, with a warning that names its line.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::Read;
use std::panic::catch_unwind;

use super::error::{Place, Warnings};
use super::keywords::{KEYWORDS, Kind};
use super::lines::{Lines, decode, excerpt, split_keyword, words};
use super::map_options::split_options;
use super::numbers::parse as number;

/// A material as its library describes it, every number finite and within its range.
#[derive(Clone, Debug)]
pub struct MtlMaterial {
    /// The statements. `Pr`, `Pm`, `Tr` and `map_Ke` are among the `unknown_param`.
    pub statements: tobj::Material,
    /// Where it begins.
    pub place: Place,
    /// The line of each statement that names a file.
    map_lines: BTreeMap<&'static str, u64>,
}

impl MtlMaterial {
    /// Where the statement `keyword` names a file.
    pub fn map_place(&self, keyword: &str) -> Place {
        let line = self.map_lines.get(keyword).copied().unwrap_or(self.place.line);
        Place::new(&self.place.file, line)
    }

    /// A number that `tobj` does not know by name.
    pub fn number(&self, keyword: &str) -> Option<f32> {
        self.statements.unknown_param.get(keyword)?.parse().ok()
    }
}

/// Reads a library, `file` being its name for messages. Never fails: what cannot be read is missing.
pub fn read(reader: impl Read, file: &str, max_bytes: u64, warnings: &mut Warnings) -> Vec<MtlMaterial> {
    let mut library = Library::default();
    let mut lines = Lines::new(reader, file, max_bytes);
    loop {
        match lines.next() {
            Ok(Some((number, line))) => library.rewrite(&Place::new(file, number), line, warnings),
            Ok(None) => break,
            Err(error) => {
                warnings.push(lines.place(), format!("the rest of the library is ignored: {error}"));
                break;
            }
        }
    }
    for (keyword, (place, count)) in library.unsupported {
        warnings
            .push(place, format!("`{keyword}` is not supported and ignored ({count} in all, the first on this line)"));
    }
    // As with geometry: checked statements give tobj no reason to fail.
    match catch_unwind(|| tobj::load_mtl_buf(&mut library.text.as_bytes())) {
        Ok(Ok((materials, _))) => {
            let materials = materials.into_iter().zip(library.begins);
            let bind = |(statements, (place, map_lines))| MtlMaterial { statements, place, map_lines };
            materials.map(bind).collect()
        }
        Ok(Err(_)) | Err(_) => {
            warnings.push(Place::new(file, 0), "the library cannot be read; its materials are grey");
            Vec::new()
        }
    }
}

/// Statements rewritten so far.
#[derive(Default)]
struct Library {
    text: String,
    /// Where each material begins, and the lines of its statements that name files.
    begins: Vec<(Place, BTreeMap<&'static str, u64>)>,
    unsupported: BTreeMap<String, (Place, u64)>,
}

impl Library {
    fn rewrite(&mut self, place: &Place, line: &[u8], warnings: &mut Warnings) {
        let (keyword, rest) = split_keyword(line);
        if keyword.is_empty() || keyword[0] == b'#' {
            return;
        }
        if keyword.eq_ignore_ascii_case(b"newmtl") {
            let mut name = decode(rest).trim().to_owned();
            if name.is_empty() {
                warnings.push(place.clone(), "`newmtl` without a name");
                name = "(unnamed)".to_owned();
            }
            self.begins.push((place.clone(), BTreeMap::new()));
            self.push("newmtl", &name);
            return;
        }
        if self.begins.is_empty() {
            let message = format!("`{}` before the first `newmtl` is ignored", excerpt(keyword));
            warnings.push(place.clone(), message);
            return;
        }
        let known = KEYWORDS.iter().find(|(known, _)| keyword.eq_ignore_ascii_case(known.as_bytes()));
        match known {
            None => self.note_unsupported(place, &excerpt(keyword)),
            Some((keyword, Kind::Unsupported)) => self.note_unsupported(place, keyword),
            Some((_, Kind::Silent)) => {}
            Some((keyword, Kind::Color(max))) => self.color(place, keyword, rest, *max, warnings),
            Some((keyword, Kind::Number(min, max))) => self.number(place, keyword, rest, *min..=*max, warnings),
            Some((keyword, Kind::Map)) => self.map(place, keyword, rest, warnings),
            Some((keyword, Kind::Model)) => match words(rest).next().and_then(number) {
                Some(model) if (0.0..=10.0).contains(&model) => self.push(keyword, &format!("{}", model as u8)),
                _ => {
                    let message = format!("`illum {}` is ignored: models go from 0 to 10", excerpt(rest));
                    warnings.push(place.clone(), message);
                }
            },
        }
    }

    fn push(&mut self, keyword: &str, value: &str) {
        // Names may hold characters that tobj takes for line ends; lines themselves have none.
        let value = value.replace(['\n', '\r'], " ");
        writeln!(self.text, "{keyword} {value}").expect("writing to memory succeeds");
    }

    fn note_unsupported(&mut self, place: &Place, keyword: &str) {
        const MAX_KEYWORDS: usize = 64;
        if let Some((_, count)) = self.unsupported.get_mut(keyword) {
            *count += 1;
        } else if self.unsupported.len() < MAX_KEYWORDS {
            self.unsupported.insert(keyword.to_owned(), (place.clone(), 1));
        }
    }

    fn color(&mut self, place: &Place, keyword: &str, rest: &[u8], max: f64, warnings: &mut Warnings) {
        let words: Vec<_> = words(rest).take(3).collect();
        if let Some(kind @ (b"spectral" | b"xyz")) = words.first().copied() {
            let message = format!("`{keyword} {}` is ignored: only RGB colours are supported", excerpt(kind));
            warnings.push(place.clone(), message);
            return;
        }
        let parsed: Option<Vec<f64>> = words.iter().map(|word| number(word)).collect();
        let color = match parsed.as_deref() {
            Some(&[grey]) => [grey; 3],
            Some(&[red, green]) => {
                warnings.push(place.clone(), format!("`{keyword}` has two components; blue is taken to be {green}"));
                [red, green, green]
            }
            Some(&[red, green, blue]) => [red, green, blue],
            _ => {
                warnings.push(place.clone(), format!("`{keyword} {}` is ignored: not a colour", excerpt(rest)));
                return;
            }
        };
        // NaN becomes 0; a comparison decides, because `clamp` keeps it.
        let clamped = color.map(|x| if x > 0.0 { x.min(max) } else { 0.0 });
        if clamped != color && keyword != "Ka" {
            let message = format!("`{keyword} {}` is out of range and was clamped to 0..={max:?}", excerpt(rest));
            warnings.push(place.clone(), message);
        }
        let [red, green, blue] = clamped.map(|x| x.min(f64::from(f32::MAX)));
        self.push(keyword, &format!("{red:e} {green:e} {blue:e}"));
    }

    fn number(
        &mut self,
        place: &Place,
        keyword: &str,
        rest: &[u8],
        range: std::ops::RangeInclusive<f64>,
        warnings: &mut Warnings,
    ) {
        let mut words = words(rest);
        let mut word = words.next();
        if word == Some(b"-halo") {
            warnings.push(place.clone(), "`-halo` is ignored");
            word = words.next();
        }
        let Some(value) = word.and_then(number).filter(|value| !value.is_nan()) else {
            warnings.push(place.clone(), format!("`{keyword} {}` is ignored: not a number", excerpt(rest)));
            return;
        };
        let clamped = value.clamp(*range.start(), *range.end());
        if clamped != value {
            warnings.push(place.clone(), format!("`{keyword} {value}` is out of range and was clamped to {clamped}"));
        }
        self.push(keyword, &format!("{clamped:e}"));
    }

    fn map(&mut self, place: &Place, keyword: &'static str, rest: &[u8], warnings: &mut Warnings) {
        let (ignored, name) = split_options(rest);
        if !ignored.is_empty() {
            let message = format!("options of `{keyword}` are not supported and ignored: `{}`", ignored.join(" "));
            warnings.push(place.clone(), message);
        }
        let name = decode(name);
        let name = name.trim().trim_matches('"');
        if name.is_empty() {
            warnings.push(place.clone(), format!("`{keyword}` without a file name is ignored"));
        } else {
            self.push(keyword, name);
            if let Some((_, map_lines)) = self.begins.last_mut() {
                map_lines.insert(keyword, place.line);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> (Vec<MtlMaterial>, Vec<String>) {
        let mut warnings = Warnings::default();
        let materials = read(text.as_bytes(), "t.mtl", u64::MAX, &mut warnings);
        (materials, warnings.into_vec().iter().map(ToString::to_string).collect())
    }

    fn one(statements: &str) -> (tobj::Material, Vec<String>) {
        let (mut materials, warnings) = parse(&format!("newmtl m\n{statements}"));
        assert_eq!(materials.len(), 1);
        (materials.remove(0).statements, warnings)
    }

    #[test]
    fn one_component_means_grey() {
        assert_eq!(one("Kd 0.5").0.diffuse, Some([0.5; 3]));
        let (material, warnings) = one("Ke 1 2");
        assert_eq!(material.emissive, Some([1.0, 2.0, 2.0]));
        assert_eq!(warnings, ["t.mtl:2: `Ke` has two components; blue is taken to be 2"]);
    }

    #[test]
    fn a_statement_that_is_not_understood_costs_only_itself() {
        let (material, warnings) = one("Kd spectral x.rfl\nillum 300\nNs\nKs a b c\nKe 1 2 3 # lamp\nKd");
        assert_eq!((material.diffuse, material.specular), (None, None));
        assert_eq!(material.emissive, Some([1.0, 2.0, 3.0]));
        assert_eq!(
            warnings,
            [
                "t.mtl:2: `Kd spectral` is ignored: only RGB colours are supported",
                "t.mtl:3: `illum 300` is ignored: models go from 0 to 10",
                "t.mtl:4: `Ns ` is ignored: not a number",
                "t.mtl:5: `Ks a b c` is ignored: not a colour",
                "t.mtl:7: `Kd ` is ignored: not a colour",
            ]
        );
    }

    #[test]
    fn values_outside_their_range_are_clamped() {
        let (material, warnings) = one("Kd -1 inf NaN\nKe nan -3 1e30\nd 7");
        assert_eq!(material.diffuse, Some([0.0, 1.0, 0.0]));
        assert_eq!(material.emissive, Some([0.0, 0.0, 1e20]));
        assert_eq!(material.dissolve, Some(1.0));
        assert_eq!(warnings.len(), 3);
        assert_eq!(warnings[0], "t.mtl:2: `Kd -1 inf NaN` is out of range and was clamped to 0..=1.0");
    }

    #[test]
    fn options_do_not_become_part_of_a_file_name() {
        assert_eq!(one("map_Kd -s 1 1 1 t.png").0.diffuse_texture.as_deref(), Some("t.png"));
        assert_eq!(one("map_Kd -s 2 t u.png").0.diffuse_texture.as_deref(), Some("t u.png"));
        assert_eq!(one("map_Kd -o 1 1 1 1").0.diffuse_texture.as_deref(), Some("1"));
        assert_eq!(one("map_d -clamp on -imfchan m \"a b.png\"").0.dissolve_texture.as_deref(), Some("a b.png"));
        let (_, warnings) = one("map_Kd -s 2 2 1 -o 0 0 0 t.png");
        assert_eq!(warnings, ["t.mtl:2: options of `map_Kd` are not supported and ignored: `-s 2 2 1`"]);
    }

    #[test]
    fn keywords_are_known_in_any_case() {
        let (material, _) = one("kd 0 0 1\nMAP_KD t.png\nmap_ke e.png\nPR 0.25");
        assert_eq!(material.diffuse, Some([0.0, 0.0, 1.0]));
        assert_eq!(material.diffuse_texture.as_deref(), Some("t.png"));
        assert_eq!(material.unknown_param["map_Ke"], "e.png");
        assert_eq!(material.unknown_param["Pr"], "2.5e-1");
    }

    #[test]
    fn unsupported_statements_are_named_once() {
        let (_, warnings) = parse("newmtl a\nmap_Pr r.png\nnewmtl b\nmap_Pr s.png\nKq 3");
        assert_eq!(
            warnings,
            [
                "t.mtl:5: `Kq` is not supported and ignored (1 in all, the first on this line)",
                "t.mtl:2: `map_Pr` is not supported and ignored (2 in all, the first on this line)",
            ]
        );
    }

    #[test]
    fn materials_know_where_they_begin() {
        let (materials, warnings) = parse("Kd 1 1 1\n\nnewmtl caf\u{e9} au lait\nKd 1\nnewmtl\nKd 0");
        assert_eq!(materials[0].statements.name, "caf\u{e9} au lait");
        assert_eq!(materials[0].place.line, 3);
        assert_eq!(materials[1].place.line, 5);
        assert_eq!(warnings.len(), 2);
    }
}
