//! The compiled shaders against the pass table and the layouts of the host, without a GPU.

mod spirv;

use std::{collections::BTreeMap, mem::offset_of};

use glam::{Vec3, Vec4};
use rspirv::{
    dr::{Module, load_words},
    spirv::{Capability, Decoration, ExecutionMode, Op, StorageClass},
};
use spirv::{Element, Reader};
use weir::{
    executor::gpu::{Bound, bound_with_queries},
    shaders,
};
use weir_shader::{
    DRAWS, PASSES,
    wiring::{Access, Draw, Pass},
};
use weir_shared::{
    block::Block,
    frame::{Frame, FramePair},
    moments::Moments,
    presample::LightRecord,
    resample::Candidate,
    reservoir::Reservoir,
    surface::Surface,
    tiles::LIST_VECTORS,
    window::Window,
};

/// What WebGPU grants without asking, beside the uniform.
const MOST_STORAGE_BUFFERS: usize = 8;
/// Passes that look at two frames at once bind one more; the plan says so.
const ONE_MORE: [&str; 3] = ["temporal_rays", "temporal", "temporal_any_form"];

fn plain() -> Module {
    load_words(shaders::plain()).expect("SPIR-V")
}

fn strict() -> Module {
    load_words(shaders::strict()).expect("SPIR-V")
}

fn ray_query() -> Module {
    load_words(shaders::ray_query()).expect("SPIR-V")
}

/// Runs a check on both modules of all passes; the failure says which.
fn on_each_module(check: impl Fn(&Module) -> Result<(), String>) {
    for (name, module) in [("plain", plain()), ("strict", strict())] {
        if let Err(message) = check(&module) {
            panic!("{name} module: {message}");
        }
    }
}

/// A type of a field, as [`Reader::shape`] writes it.
trait Member {
    const SHAPE: &'static str;
}

impl Member for u32 {
    const SHAPE: &'static str = "u32";
}

impl Member for f32 {
    const SHAPE: &'static str = "f32";
}

impl Member for Vec3 {
    const SHAPE: &'static str = "f32x3";
}

impl Member for Vec4 {
    const SHAPE: &'static str = "f32x4";
}

impl Member for [f32; 3] {
    const SHAPE: &'static str = "[f32; 3]";
}

fn shape_of<S, T: Member>(_: fn(&S) -> &T) -> String {
    T::SHAPE.to_owned()
}

/// Name, offset and shape of every field in the order of the list; that none is missing is for the compiler to check.
macro_rules! fields {
    ($type:ident { $($field:ident),* $(,)? }) => {{
        let $type { $($field: _),* } = $type::default();
        vec![$((stringify!($field), offset_of!($type, $field) as u32, shape_of(|s: &$type| &s.$field))),*]
    }};
}

type Fields = Vec<(&'static str, u32, String)>;

fn frame_fields() -> Fields {
    fields!(Frame {
        width,
        height,
        index,
        seed,
        camera_origin,
        accumulated,
        camera_right,
        camera_rays,
        camera_up,
        exposure,
        camera_forward,
        top_root,
        instance_count,
        top_order_at,
        instances_at,
        materials_at,
        textures_at,
        emitters_at,
        emitter_count,
        light_count,
        candidates,
        source,
        environment_table_at,
        environment_texels_at,
        environment_width,
        environment_height,
        environment_cos,
        environment_sin,
        environment_scale,
        reservoirs,
        round,
        choice,
        candidates_bsdf,
        candidates_full,
        mis_form,
        has_history,
        temporal_neighbors,
        temporal_neighbors_unseen,
        spatial_neighbors,
        spatial_neighbors_unseen,
        confidence_cap,
        neighbor_rule,
        radius_px,
        normal_cosine,
        plane_tolerance,
        roughness_tolerance,
        probe,
        lattice,
        occlusion_reach,
        occlusion,
        candidates_off_lattice,
        candidates_tree,
        light_guide_at,
        light_guide_shift,
        distant_at,
        light_tree_at,
        presampled_columns,
        presampled_rows,
        cell_size,
        cell_candidates,
        light_cuts_at,
        not_skipped,
        found_moment,
        block,
    })
}

fn window_fields() -> Fields {
    fields!(Window {
        width,
        height,
        left_px,
        top_px,
        step_x,
        step_y,
        divider_px,
        smooth,
        linear_target,
        divided,
        padding,
        padding_end,
    })
}

/// The fields of an element of a resource; none where it is a number or a vector.
fn fields_of(resource: &str) -> Option<Fields> {
    match resource.strip_prefix("prev_").unwrap_or(resource) {
        "surfaces" => Some(fields!(Surface {
            position,
            error,
            normal_geometric,
            normal_shading,
            specular_rg,
            specular_b_roughness,
            diffuse,
            instance,
        })),
        "bsdf_hits" | "fresh" | "unseen" | "visible" | "marked" | "merged" | "merging" | "reservoirs" => {
            Some(fields!(Reservoir { light, uv, ucw, state }))
        }
        "presampled" => {
            Some(fields!(LightRecord { position, light, area, uv, radiance, pmf, scale, state, emitter, local }))
        }
        "blocks" => Some(fields!(Block { position, normal, low, high, normal_low, normal_high })),
        "resident" => Some(fields!(Candidate { light, uv, target, weight, fault })),
        "moments" => Some(fields!(Moments { mean, count, carry, faults, deviation, fault })),
        _ => None,
    }
}

/// Whether a structure of a module has these fields.
fn same_fields(reader: &Reader, structure: u32, expected: &Fields) -> Result<(), String> {
    let found = reader.members(structure);
    if found.len() != expected.len() {
        return Err(format!("{} fields, the host has {}", found.len(), expected.len()));
    }
    for ((name, offset, shape), (found_offset, found_shape)) in expected.iter().zip(found) {
        if (*offset, shape) != (found_offset, &found_shape) {
            return Err(format!("`{name}` is {shape} at {offset} on the host, {found_shape} at {found_offset} here"));
        }
    }
    Ok(())
}

/// Entry point by name, with its pass.
fn variants(passes: &'static [Pass]) -> BTreeMap<&'static str, &'static Pass> {
    passes.iter().flat_map(|pass| pass.variants.iter().map(move |v| (v.entry_point, pass))).collect()
}

/// What is drawn, by its entry points: both stages of each row.
fn stages() -> BTreeMap<&'static str, &'static Draw> {
    DRAWS.iter().flat_map(|draw| [(draw.vertex, draw), (draw.fragment, draw)]).collect()
}

fn check_entry_points(module: &Module, passes: &'static [Pass]) -> Result<(), String> {
    check_names(module, variants(passes), stages())
}

/// Whether a module has the entry points expected, and no others.
fn check_names(
    module: &Module,
    mut expected: BTreeMap<&'static str, &'static Pass>,
    mut drawn: BTreeMap<&'static str, &'static Draw>,
) -> Result<(), String> {
    let reader = Reader::new(module);
    for (function, name) in reader.entry_points() {
        if let Some(draw) = drawn.remove(name) {
            let upper_left = reader.execution_mode(function, ExecutionMode::OriginUpperLeft).is_some();
            if upper_left != (name == draw.fragment) {
                return Err(format!("entry point `{name}` is not the stage that the table says"));
            }
            continue;
        }
        if expected.remove(name).is_none() {
            return Err(format!("entry point `{name}` is not in the table"));
        }
        if name.ends_with(|c: char| c.is_ascii_digit()) {
            return Err(format!("entry point `{name}` ends in a digit, which naga would change"));
        }
        let size = reader.execution_mode(function, ExecutionMode::LocalSize);
        if size != Some(vec![8, 8, 1]) {
            return Err(format!("entry point `{name}` has workgroups of {size:?}"));
        }
    }
    match expected.keys().chain(drawn.keys()).next() {
        Some(name) => Err(format!("there is no entry point `{name}`")),
        None => Ok(()),
    }
}

fn check_bindings(module: &Module, passes: &'static [Pass]) -> Result<(), String> {
    let reader = Reader::new(module);
    let passes = variants(passes);
    for (function, name) in reader.entry_points() {
        if let Some(draw) = stages().get(name) {
            for variable in reader.globals_of(function) {
                check_drawn(&reader, draw, variable).map_err(|e| format!("entry point `{name}`: {e}"))?;
            }
            continue;
        }
        let pass = passes.get(name).ok_or_else(|| format!("entry point `{name}` is not in the table"))?;
        if pass.storage_buffers() > MOST_STORAGE_BUFFERS + usize::from(ONE_MORE.contains(&pass.name)) {
            return Err(format!("pass `{}` has {} storage buffers", pass.name, pass.storage_buffers()));
        }
        let bound: Vec<Bound> = (0..pass.bindings.len()).map(Bound::Buffer).collect();
        for variable in reader.globals_of(function) {
            check_binding(&reader, pass, &bound, variable).map_err(|e| format!("entry point `{name}`: {e}"))?;
        }
    }
    Ok(())
}

/// The passes that trace rays, by their entry points.
fn tracing() -> BTreeMap<&'static str, &'static Pass> {
    let traces = |pass: &Pass| bound_with_queries(pass).contains(&Bound::Top(0));
    variants(PASSES).into_iter().filter(|(_, pass)| traces(pass)).collect()
}

/// What passes bind in the module that asks ray queries.
fn check_bindings_with_queries(module: &Module) -> Result<(), String> {
    let reader = Reader::new(module);
    let passes = tracing();
    for (function, name) in reader.entry_points() {
        let pass = passes.get(name).ok_or_else(|| format!("entry point `{name}` traces no rays"))?;
        let bound = bound_with_queries(pass);
        let variables = reader.globals_of(function);
        for &variable in &variables {
            check_binding(&reader, pass, &bound, variable).map_err(|e| format!("entry point `{name}`: {e}"))?;
        }
        let tops = variables.iter().filter(|v| reader.storage_class(**v) == StorageClass::UniformConstant).count();
        if tops != 2 {
            return Err(format!("entry point `{name}` uses {tops} acceleration structures"));
        }
    }
    Ok(())
}

/// A variable of a stage: a built-in, the window, or one of the pictures.
fn check_drawn(reader: &Reader, draw: &Draw, variable: u32) -> Result<(), String> {
    let class = reader.storage_class(variable);
    if matches!(class, StorageClass::Input | StorageClass::Output) {
        return Ok(());
    }
    let number = reader.decoration(variable, Decoration::Binding).ok_or("a global variable has no binding")?;
    match (class, number) {
        (StorageClass::Uniform, 0) => {
            let window = reader.pointee(variable).ok_or("the uniform is no structure")?;
            same_fields(reader, window, &window_fields())
        }
        (StorageClass::StorageBuffer, 1..) => {
            let binding = draw.bindings.get(number as usize - 1).ok_or("a binding is not in the table")?;
            let array = reader.array_block(variable).ok_or("no block of one array")?;
            let read_only = reader.has_decoration(variable, Decoration::NonWritable);
            match array.stride as usize == binding.stride && read_only {
                true => Ok(()),
                false => Err(format!("`{}` has stride {}, read-only: {read_only}", binding.name, array.stride)),
            }
        }
        _ => Err(format!("{class:?} is not for binding {number}")),
    }
}

fn check_binding(reader: &Reader, pass: &Pass, bound: &[Bound], variable: u32) -> Result<(), String> {
    let class = reader.storage_class(variable);
    if class == StorageClass::Input {
        return Ok(());
    }
    let number = reader.decoration(variable, Decoration::Binding).ok_or("a global variable has no binding")?;
    if reader.decoration(variable, Decoration::DescriptorSet) != Some(0) {
        return Err(format!("binding {number} is not in set 0"));
    }
    let of = |error: String| format!("binding {number}: {error}");
    let place = number.checked_sub(1).and_then(|place| bound.get(place as usize)).copied();
    match (class, number) {
        (StorageClass::Uniform, 0) => {
            let pair = reader.block(variable).ok_or("the uniform is no block of one structure")?;
            let frames = reader.member_types(pair);
            let offsets: Vec<u32> = frames.iter().map(|f| f.0).collect();
            if offsets != [offset_of!(FramePair, now) as u32, offset_of!(FramePair, prev) as u32] {
                return Err(of(format!("frames at {offsets:?}")));
            }
            frames.iter().try_for_each(|&(_, frame)| same_fields(reader, frame, &frame_fields())).map_err(of)
        }
        (StorageClass::Uniform, 1..) => {
            let Some(Bound::Buffer(place)) = place else { return Err(of("not in the table".into())) };
            let binding = &pass.bindings[place];
            let list = reader.block(variable).ok_or_else(|| of("the uniform is no block of one structure".into()))?;
            let expected = format!("[u32x4; {LIST_VECTORS}]");
            match same_fields(reader, list, &vec![("vectors", 0, expected)]) {
                Ok(()) if binding.is_uniform => Ok(()),
                Ok(()) => Err(of(format!("`{}` is no uniform in the table", binding.name))),
                Err(error) => Err(of(format!("`{}`: {error}", binding.name))),
            }
        }
        (StorageClass::StorageBuffer, 1..) => {
            let Some(Bound::Buffer(place)) = place else { return Err(of("not in the table".into())) };
            let binding = &pass.bindings[place];
            if binding.is_uniform {
                return Err(of(format!("`{}` is a uniform in the table", binding.name)));
            }
            let read_only = reader.has_decoration(variable, Decoration::NonWritable);
            if read_only != (binding.access == Access::Read) {
                return Err(of(format!(
                    "`{}` is {:?} in the table, read-only: {read_only}",
                    binding.name, binding.access
                )));
            }
            let array = reader.array_block(variable).ok_or_else(|| of("no block of one array".into()))?;
            if array.stride as usize != binding.stride {
                return Err(of(format!("`{}` has stride {}, not {}", binding.name, array.stride, binding.stride)));
            }
            match (array.element, fields_of(binding.name)) {
                (Element::Structure(id), Some(fields)) => {
                    same_fields(reader, id, &fields).map_err(|e| of(format!("`{}`: {e}", binding.name)))
                }
                (Element::Numbers { bytes }, None) if bytes as usize == binding.stride => Ok(()),
                (element, fields) => Err(of(format!("`{}` is {element:?}, not {fields:?}", binding.name))),
            }
        }
        (StorageClass::UniformConstant, _) if matches!(place, Some(Bound::Top(_))) => {
            match reader.is_acceleration_structure(variable) {
                true => Ok(()),
                false => Err(of("no acceleration structure".into())),
            }
        }
        _ => Err(of(format!("{class:?} is not for there"))),
    }
}

/// Float operations that a driver may contract: those that lack the decoration.
fn contractible(module: &Module) -> usize {
    let reader = Reader::new(module);
    let is_arithmetic = |name: &str| {
        ["FNegate", "FAdd", "FSub", "FMul", "FDiv", "FRem", "FMod", "Dot", "OuterProduct"].contains(&name)
            || name.starts_with("VectorTimes")
            || name.starts_with("MatrixTimes")
    };
    module
        .all_inst_iter()
        .filter(|i| is_arithmetic(i.class.opname.strip_prefix("Op").unwrap_or(i.class.opname)))
        .filter_map(|i| i.result_id)
        .filter(|id| !reader.has_decoration(*id, Decoration::NoContraction))
        .count()
}

#[test]
fn every_variant_of_every_pass_has_an_entry_point() {
    on_each_module(|module| check_entry_points(module, PASSES));
}

#[test]
fn the_module_with_ray_queries_has_the_passes_that_trace_rays_with_acceleration_structures_for_nodes() {
    let module = ray_query();
    let asks = |module: &Module| {
        let capabilities: Vec<_> = module.capabilities.iter().map(|i| i.operands[0].unwrap_capability()).collect();
        let extensions: Vec<_> = module.extensions.iter().map(|i| i.operands[0].unwrap_literal_string()).collect();
        (capabilities, extensions.join(" "))
    };
    let (capabilities, extensions) = asks(&module);
    assert!(capabilities.contains(&Capability::Shader) && capabilities.contains(&Capability::RayQueryKHR));
    assert_eq!((capabilities.len(), extensions.as_str()), (2, "SPV_KHR_ray_query"), "{capabilities:?}");
    assert_eq!(check_names(&module, tracing(), BTreeMap::new()), Ok(()));
    assert_eq!(check_bindings_with_queries(&module), Ok(()));
    assert_eq!(check_numbers(&module), Ok(()));
    assert_eq!(contractible(&module), 0);
    // Seen to fail: the module that traverses nodes is another one.
    assert!(check_bindings_with_queries(&plain()).is_err());
}

#[test]
fn the_entry_point_check_sees_a_pass_too_many_and_one_too_few() {
    assert!(check_entry_points(&plain(), &PASSES[1..]).is_err_and(|e| e.contains("is not in the table")));
    let mut module = plain();
    module.entry_points.pop();
    assert!(check_entry_points(&module, PASSES).is_err_and(|e| e.contains("there is no entry point")));
}

#[test]
fn bindings_strides_and_offsets_are_those_of_the_host() {
    on_each_module(|module| check_bindings(module, PASSES));
}

/// What the checks above say of a module in which one operand of one decoration is another.
fn with_decoration(which: Decoration, from: u32, to: u32) -> Result<(), String> {
    let mut module = plain();
    let operands = module.annotations.iter_mut().map(|i| &mut i.operands);
    let operand = operands
        .filter(|o| o.contains(&which.into()))
        .filter_map(|o| o.last_mut())
        .find(|o| **o == from.into())
        .expect("a decoration to change");
    *operand = to.into();
    check_bindings(&module, PASSES)
}

#[test]
fn the_binding_check_sees_a_wrong_number_stride_offset_and_access() {
    assert!(with_decoration(Decoration::Binding, 1, 9).is_err());
    assert!(with_decoration(Decoration::DescriptorSet, 0, 1).is_err_and(|e| e.contains("set 0")));
    assert!(with_decoration(Decoration::ArrayStride, 48, 44).is_err_and(|e| e.contains("stride")));
    assert!(with_decoration(Decoration::Offset, 148, 152).is_err_and(|e| e.contains("`reservoirs`")));
    let mut module = plain();
    module.annotations.retain(|i| !i.operands.contains(&Decoration::NonWritable.into()));
    assert!(check_bindings(&module, PASSES).is_err_and(|e| e.contains("read-only")));
}

#[test]
fn the_field_check_sees_two_fields_swapped() {
    let module = plain();
    let reader = Reader::new(&module);
    let pair = reader.uniform().and_then(|variable| reader.block(variable)).expect("a uniform block");
    let (_, frame) = reader.member_types(pair)[0];
    let mut fields = frame_fields();
    assert_eq!(same_fields(&reader, frame, &fields), Ok(()));
    let swapped = fields.iter().position(|f| f.0 == "camera_rays").expect("a field");
    fields.swap(swapped, swapped - 2);
    assert!(same_fields(&reader, frame, &fields).is_err());
}

#[test]
fn the_shaders_ask_for_no_optional_capability_and_no_wide_or_extreme_number() {
    on_each_module(|module| {
        let capabilities: Vec<_> = module.capabilities.iter().map(|i| i.operands[0].unwrap_capability()).collect();
        if capabilities != [Capability::Shader] || !module.extensions.is_empty() {
            return Err(format!("asks for {capabilities:?} and {} extensions", module.extensions.len()));
        }
        check_numbers(module)
    });
}

fn check_numbers(module: &Module) -> Result<(), String> {
    let reader = Reader::new(module);
    for instruction in &module.types_global_values {
        match instruction.class.opcode {
            Op::TypeInt | Op::TypeFloat if instruction.operands[0].unwrap_literal_bit32() != 32 => {
                return Err(format!("has a number that is not of 32 bits: {instruction:?}"));
            }
            Op::Constant if reader.float(instruction).is_some_and(|value| !is_portable(value)) => {
                return Err(format!("has a literal that compilers take for infinity: {instruction:?}"));
            }
            _ => {}
        }
    }
    Ok(())
}

/// Some compilers of shaders reject literals that are not finite, or that print as more than they hold.
fn is_portable(literal: f32) -> bool {
    literal.abs() < 3.4e38
}

#[test]
fn extreme_literals_are_told_from_others() {
    assert!(is_portable(1e30) && is_portable(-3.0e38) && is_portable(0.0));
    assert!(!is_portable(f32::MAX) && !is_portable(f32::NEG_INFINITY) && !is_portable(f32::NAN));
}

#[test]
fn no_float_operation_of_the_strict_module_may_be_contracted() {
    assert_eq!(contractible(&strict()), 0);
    // Seen to fail: the plain module leaves it to the driver, in thousands of places.
    assert!(contractible(&plain()) > 1000);
}

#[test]
fn naga_accepts_the_plain_module_without_capabilities() {
    use naga::{
        front::spv::{Options, parse_u8_slice},
        valid::{Capabilities, ValidationFlags, Validator},
    };
    let options = Options { adjust_coordinate_space: false, strict_capabilities: true, ..Default::default() };
    let bytes: Vec<u8> = shaders::plain().iter().flat_map(|word| word.to_le_bytes()).collect();
    let module = parse_u8_slice(&bytes, &options).expect("naga reads the module");
    assert_eq!(module.entry_points.len(), variants(PASSES).len() + stages().len());
    let mut validator = Validator::new(ValidationFlags::all(), Capabilities::empty());
    if let Err(error) = validator.validate(&module) {
        panic!("naga rejects the module: {error:?}");
    }
}

#[test]
fn the_modules_hold_no_paths_and_no_sources() {
    for (name, words) in
        [("plain", shaders::plain()), ("strict", shaders::strict()), ("ray query", shaders::ray_query())]
    {
        let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
        let text = String::from_utf8_lossy(&bytes);
        for word in [".rs", "/src", "\\src", "home", "cargo"] {
            assert!(!text.contains(word), "{name} module: contains `{word}`");
        }
        assert!(text.contains("entry::"), "{name} module: has names");
    }
}
