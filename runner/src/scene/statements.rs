//! OBJ statements, checked and rewritten into the few forms that `tobj` reads without surprises.
//!
//! - Faces name a position, a texture coordinate and a normal for each corner, counted from the start and in
//!   range; what a corner lacks is the first of its kind, (0, 0) or a zero vector, from [`Statements::PROLOGUE`].
//! - Positions have three columns and texture coordinates two; a position that is not finite becomes NaN in all three.
//! - `usemtl NAME` becomes `o NUMBER`, the index of the name in [`Statements::material_names`]: `tobj` then makes
//!   a model of each run of faces with one material, and libraries may come later than the use of their materials.
//! - Everything else is dropped, with a warning where it would have shown.

use std::collections::HashMap;
use std::io::Write as _;

use super::error::{Place, SceneError, Warnings};
use super::lines::{decode, excerpt, split_keyword, words};
use super::numbers::{is_plain, parse, parse_index, write_corner, write_number, write_word};

/// The most triangles, and the most positions, texture coordinates or normals, that a file may hold.
pub const MAX_ELEMENTS: u32 = 1 << 25;

/// `tobj` keeps a hundred bytes for each face of the current model, so models are cut after this many.
const FACES_PER_MODEL: u32 = 1 << 18;

/// Coordinates beyond this are treated as not finite, so that squared areas stay finite in f32.
const MAX_COORDINATE: f64 = 1e9;

/// Statements without a meaning for triangle meshes, ignored in silence.
const SILENT: [&[u8]; 8] = [b"o", b"g", b"s", b"mg", b"lod", b"bevel", b"c_interp", b"d_interp"];

/// Curves, surfaces, lines and points: geometry, but nothing to trace.
const NOT_TRIANGLES: [&[u8]; 18] = [
    b"l", b"p", b"vp", b"cstype", b"deg", b"bmat", b"step", b"curv", b"curv2", b"surf", b"parm", b"trim", b"hole",
    b"scrv", b"sp", b"con", b"ctech", b"end",
];

/// Material libraries beyond this many are not opened.
pub const MAX_LIBRARIES: usize = 256;

/// Unknown keywords beyond this many are not named one by one.
const MAX_UNKNOWN: usize = 8;

/// The lists that a corner of a face refers to, in the order of `v/vt/vn`.
const LISTS: [&str; 3] = ["vertices (`v`)", "texture coordinates (`vt`)", "normals (`vn`)"];

/// How often something happened, and on which line first.
#[derive(Clone, Copy, Default)]
struct Tally {
    count: u64,
    first_line: u64,
}

impl Tally {
    fn add(&mut self, line: u64) {
        if self.count == 0 {
            self.first_line = line;
        }
        self.count += 1;
    }
}

/// What the statements of a file, so far, amount to.
pub struct Statements {
    file: String,
    /// What was left out or replaced.
    pub warnings: Warnings,
    /// The names that `usemtl` gave, in order of first use; the model called `N` has the N-th.
    pub material_names: Vec<String>,
    /// The line where each of them comes first.
    pub material_lines: Vec<u64>,
    /// The file names of each `mtllib`, and the line it is on.
    pub material_libraries: Vec<(String, u64)>,
    /// Whether any corner of a face has a texture coordinate.
    pub has_uvs: bool,
    /// Whether any corner of a face has a normal.
    pub has_normals: bool,
    material_numbers: HashMap<String, usize>,
    material: Option<usize>,
    /// How many positions, texture coordinates and normals there are so far.
    counts: [u32; 3],
    triangles: u64,
    faces_in_model: u32,
    unknown: Vec<Vec<u8>>,
    colored: Tally,
    positions_not_finite: Tally,
    uvs_not_finite: Tally,
    normals_not_finite: Tally,
    not_triangles: Tally,
    too_few_corners: Tally,
    too_many_libraries: Tally,
}

impl Statements {
    /// What comes before the first statement: what corners without texture coordinate or normal refer to.
    pub const PROLOGUE: &[u8] = b"vt 0 0\nvn 0 0 0\n";

    /// None yet; `file` is the name for messages.
    pub fn new(file: &str) -> Self {
        Self {
            file: file.to_owned(),
            warnings: Warnings::default(),
            material_names: Vec::new(),
            material_lines: Vec::new(),
            material_libraries: Vec::new(),
            has_uvs: false,
            has_normals: false,
            material_numbers: HashMap::new(),
            material: None,
            counts: [0; 3],
            triangles: 0,
            faces_in_model: 0,
            unknown: Vec::new(),
            colored: Tally::default(),
            positions_not_finite: Tally::default(),
            uvs_not_finite: Tally::default(),
            normals_not_finite: Tally::default(),
            not_triangles: Tally::default(),
            too_few_corners: Tally::default(),
            too_many_libraries: Tally::default(),
        }
    }

    /// Appends what stands for `line` to `out`, if anything.
    ///
    /// # Errors
    /// When the statement is malformed, or refers to what the file does not hold so far.
    pub fn rewrite(&mut self, number: u64, line: &[u8], out: &mut Vec<u8>) -> Result<(), SceneError> {
        let (keyword, rest) = split_keyword(line);
        match keyword {
            b"v" => self.position(number, rest, out),
            b"vt" => self.uv(number, rest, out),
            b"vn" => self.normal(number, rest, out),
            b"f" | b"fo" => self.face(number, rest, out),
            b"usemtl" => {
                self.use_material(number, rest, out);
                Ok(())
            }
            b"mtllib" => {
                self.use_library(number, decode(rest));
                Ok(())
            }
            _ => {
                self.ignore(number, keyword);
                Ok(())
            }
        }
    }

    /// Adds the warnings that count over the whole file; call once it is read.
    pub fn finish(&mut self) {
        let mut tallies = [
            (self.colored, "vertex colours are ignored"),
            (self.positions_not_finite, "vertices with coordinates that are not finite, or beyond 1e9, are not used"),
            (self.uvs_not_finite, "texture coordinates that are not finite were replaced by (0, 0)"),
            (self.normals_not_finite, "normals that are not finite were dropped"),
            (self.not_triangles, "lines, points, curves and surfaces are ignored, only faces (`f`) are drawn"),
            (self.too_few_corners, "faces with fewer than three corners were dropped"),
            (self.too_many_libraries, "material libraries beyond the 256th are not opened"),
        ];
        tallies.sort_by_key(|(tally, _)| tally.first_line);
        for (tally, what) in tallies {
            if tally.count > 0 {
                let message = format!("{what} ({} in all, the first on this line)", tally.count);
                self.warnings.push(self.place(tally.first_line), message);
            }
        }
    }

    fn place(&self, line: u64) -> Place {
        Place::new(&self.file, line)
    }

    fn malformed(&self, line: u64, keyword: &str, rest: &[u8], help: &str) -> SceneError {
        let statement = format!("{keyword} {}", excerpt(rest));
        SceneError::bad_data(self.place(line), format!("malformed statement `{}`", statement.trim()), help)
    }

    /// Counts an element of list `list`.
    fn count(&mut self, line: u64, list: usize) -> Result<(), SceneError> {
        self.counts[list] += 1;
        if self.counts[list] > MAX_ELEMENTS {
            let what = format!("more than {MAX_ELEMENTS} {}", LISTS[list]);
            return Err(SceneError::bad_data(self.place(line), what, "split the scene, or simplify it"));
        }
        Ok(())
    }

    fn position(&mut self, line: u64, rest: &[u8], out: &mut Vec<u8>) -> Result<(), SceneError> {
        const HELP: &str = "a vertex is `v x y z`, with numbers such as 1.5 or -3e-4";
        let mut columns = [b"".as_slice(); 4];
        let mut count = 0;
        for word in words(rest) {
            if let Some(column) = columns.get_mut(count) {
                *column = word;
            }
            count += 1;
        }
        if count < 3 {
            return Err(self.malformed(line, "v", rest, HELP));
        }
        self.count(line, 0)?;
        if count > 4 {
            self.colored.add(line);
        }
        // Four columns are homogeneous coordinates, five and more a position and a colour.
        let weighted = count == 4;
        out.extend_from_slice(b"v");
        if weighted || columns[..3].iter().any(|word| !is_plain(word)) {
            let weight = if weighted { parse(columns[3]) } else { Some(1.0) };
            let parsed = (parse(columns[0]), parse(columns[1]), parse(columns[2]), weight);
            let (Some(x), Some(y), Some(z), Some(w)) = parsed else {
                return Err(self.malformed(line, "v", rest, HELP));
            };
            let position = [x / w, y / w, z / w];
            if position.iter().all(|x| x.abs() <= MAX_COORDINATE) {
                position.iter().for_each(|x| write_number(out, *x));
            } else {
                self.positions_not_finite.add(line);
                out.extend_from_slice(b" nan nan nan");
            }
        } else {
            columns[..3].iter().for_each(|word| write_word(out, word));
        }
        out.push(b'\n');
        Ok(())
    }

    fn uv(&mut self, line: u64, rest: &[u8], out: &mut Vec<u8>) -> Result<(), SceneError> {
        let mut columns = words(rest);
        let Some(u) = columns.next() else {
            return Err(self.malformed(line, "vt", rest, "a texture coordinate is `vt u v`"));
        };
        // With one column, the texture is a line.
        let columns = [u, columns.next().unwrap_or(b"0")];
        self.count(line, 1)?;
        if columns.iter().all(|word| is_plain(word) || parse(word).is_none_or(|x| x.abs() <= MAX_COORDINATE)) {
            out.extend_from_slice(b"vt");
            columns.iter().for_each(|word| write_word(out, word));
            out.push(b'\n');
        } else {
            self.uvs_not_finite.add(line);
            out.extend_from_slice(b"vt 0 0\n");
        }
        Ok(())
    }

    fn normal(&mut self, line: u64, rest: &[u8], out: &mut Vec<u8>) -> Result<(), SceneError> {
        let mut columns = words(rest);
        let (Some(x), Some(y), Some(z)) = (columns.next(), columns.next(), columns.next()) else {
            return Err(self.malformed(line, "vn", rest, "a normal is `vn x y z`"));
        };
        let columns = [x, y, z];
        self.count(line, 2)?;
        if columns.iter().all(|word| is_plain(word) || parse(word).is_none_or(|x| x.abs() <= MAX_COORDINATE)) {
            out.extend_from_slice(b"vn");
            columns.iter().for_each(|word| write_word(out, word));
            out.push(b'\n');
        } else {
            self.normals_not_finite.add(line);
            out.extend_from_slice(b"vn 0 0 0\n");
        }
        Ok(())
    }

    fn face(&mut self, line: u64, rest: &[u8], out: &mut Vec<u8>) -> Result<(), SceneError> {
        const HELP: &str = "a face is `f` and three or more of `v`, `v/vt`, `v//vn` or `v/vt/vn`, whole numbers";
        out.extend_from_slice(b"f");
        let mut corners = 0_u64;
        for word in words(rest) {
            let mut indices = [0_u32; 3];
            for (list, part) in word.split(|&byte| byte == b'/').enumerate() {
                if list == 3 || (part.is_empty() && list == 0) {
                    return Err(self.malformed(line, "f", rest, HELP));
                }
                if !part.is_empty() {
                    let Some(index) = parse_index(part) else {
                        return Err(self.malformed(line, "f", rest, HELP));
                    };
                    indices[list] = self.resolve(line, list, index)?;
                }
            }
            self.has_uvs |= indices[1] != 0;
            self.has_normals |= indices[2] != 0;
            // The prologue holds one texture coordinate and one normal, for the corners that have none.
            write_corner(out, [indices[0], indices[1] + 1, indices[2] + 1]);
            corners += 1;
        }
        if corners < 3 {
            if corners == 0 {
                return Err(self.malformed(line, "f", rest, HELP));
            }
            out.clear();
            self.too_few_corners.add(line);
            return Ok(());
        }
        out.push(b'\n');

        self.triangles += corners - 2;
        if self.triangles > u64::from(MAX_ELEMENTS) {
            let what = format!("more than {MAX_ELEMENTS} triangles");
            return Err(SceneError::bad_data(self.place(line), what, "split the scene, or simplify it"));
        }
        self.faces_in_model += 1;
        if self.faces_in_model == FACES_PER_MODEL {
            self.begin_model(out);
        }
        Ok(())
    }

    /// The index from 1 that an OBJ index stands for: negative ones count back from the last.
    fn resolve(&self, line: u64, list: usize, index: i64) -> Result<u32, SceneError> {
        let count = i64::from(self.counts[list]);
        let resolved = if index < 0 { count + 1 + index } else { index };
        if (1..=count).contains(&resolved) {
            return Ok(resolved as u32);
        }
        let what = format!("the face refers to number {index} of the {}, but there are {count} so far", LISTS[list]);
        let help = "indices count from 1, or back from -1, and what they refer to comes before the face";
        Err(SceneError::bad_data(self.place(line), what, help))
    }

    fn use_library(&mut self, line: u64, names: String) {
        if self.material_libraries.iter().any(|(known, _)| *known == names) {
            return;
        }
        match self.material_libraries.len() {
            MAX_LIBRARIES.. => self.too_many_libraries.add(line),
            _ => self.material_libraries.push((names, line)),
        }
    }

    fn use_material(&mut self, line: u64, rest: &[u8], out: &mut Vec<u8>) {
        let name = decode(rest);
        if name.is_empty() {
            self.warnings.push(self.place(line), "`usemtl` without a name; a grey material is used");
        }
        let number = match self.material_numbers.get(&name) {
            Some(&number) => number,
            None => {
                self.material_names.push(name.clone());
                self.material_lines.push(line);
                self.material_numbers.insert(name, self.material_names.len() - 1);
                self.material_names.len() - 1
            }
        };
        if self.material != Some(number) {
            self.material = Some(number);
            self.begin_model(out);
        }
    }

    fn begin_model(&mut self, out: &mut Vec<u8>) {
        self.faces_in_model = 0;
        match self.material {
            Some(number) => writeln!(out, "o {number}"),
            None => writeln!(out, "o none"),
        }
        .expect("writing to memory succeeds");
    }

    fn ignore(&mut self, line: u64, keyword: &[u8]) {
        if keyword.is_empty() || keyword[0] == b'#' || SILENT.contains(&keyword) {
            return;
        }
        if NOT_TRIANGLES.contains(&keyword) {
            self.not_triangles.add(line);
        } else if self.unknown.len() < MAX_UNKNOWN && !self.unknown.iter().any(|known| known == keyword) {
            self.unknown.push(keyword.to_vec());
            let message = format!("unknown statement `{}` is ignored, here and below", excerpt(keyword));
            self.warnings.push(self.place(line), message);
        }
    }
}
