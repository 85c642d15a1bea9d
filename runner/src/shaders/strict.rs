//! What is done to a module after rust-gpu: the debug information goes, and the strict module's arithmetic is pinned.

use rspirv::{
    binary::Assemble,
    dr::{Instruction, Module, Operand, load_bytes},
    spirv::{Decoration, Op},
};

/// Whether `op` computes with floats and may be contracted with a neighbor, as a product and a sum into one rounding.
fn is_float_arithmetic(op: Op) -> bool {
    matches!(
        op,
        Op::FNegate
            | Op::FAdd
            | Op::FSub
            | Op::FMul
            | Op::FDiv
            | Op::FRem
            | Op::FMod
            | Op::Dot
            | Op::OuterProduct
            | Op::VectorTimesScalar
            | Op::VectorTimesMatrix
            | Op::MatrixTimesScalar
            | Op::MatrixTimesVector
            | Op::MatrixTimesMatrix
    )
}

/// Whether an instruction is a name, a place in a source, or the text of one.
fn is_debug_info(instruction: &Instruction) -> bool {
    matches!(instruction.class.opcode, Op::Line | Op::NoLine)
}

/// Takes names, lines and sources out of a module: they hold paths of the machine that compiled it.
fn strip(module: &mut Module) {
    module.debug_string_source.clear();
    module.debug_names.clear();
    module.debug_module_processed.clear();
    module.types_global_values.retain(|i| !is_debug_info(i));
    for function in &mut module.functions {
        for block in &mut function.blocks {
            block.instructions.retain(|i| !is_debug_info(i));
        }
    }
}

/// Forbids contraction of every float operation.
fn pin(module: &mut Module) {
    let instructions = module.functions.iter().flat_map(|f| &f.blocks).flat_map(|b| &b.instructions);
    let results = instructions.filter(|i| is_float_arithmetic(i.class.opcode)).filter_map(|i| i.result_id);
    let decorations = results.map(|id| {
        let operands = vec![Operand::IdRef(id), Operand::Decoration(Decoration::NoContraction)];
        Instruction::new(Op::Decorate, None, None, operands)
    });
    module.annotations.extend(decorations);
}

fn bytes(module: &Module) -> Vec<u8> {
    module.assemble().into_iter().flat_map(u32::to_le_bytes).collect()
}

/// A module without its debug information.
///
/// # Errors
///
/// Where `module` is no SPIR-V, with the reason.
pub fn stripped(module: &[u8]) -> Result<Vec<u8>, String> {
    let mut module = load_bytes(module).map_err(|e| e.to_string())?;
    strip(&mut module);
    Ok(bytes(&module))
}

/// A module without its debug information whose float operations are all rounded for themselves.
///
/// # Errors
///
/// As [`stripped`].
pub fn pinned(module: &[u8]) -> Result<Vec<u8>, String> {
    let mut module = load_bytes(module).map_err(|e| e.to_string())?;
    strip(&mut module);
    pin(&mut module);
    Ok(bytes(&module))
}

/// A pinned module, optimised: the optimiser leaves float operations alone that must not be contracted. Drivers need it,
/// because their own optimisers can take time without end for the loops of a large module that has seen none.
///
/// # Errors
///
/// If `pinned` is no module.
pub fn optimized(pinned: &[u8]) -> Result<Vec<u8>, String> {
    use spirv_tools::opt::Optimizer;
    let words: Vec<u32> = pinned.chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
    let mut optimizer = spirv_tools::opt::create(Some(spirv_tools::TargetEnv::Vulkan_1_2));
    optimizer.register_performance_passes();
    let result =
        optimizer.optimize(&words, &mut |_: spirv_tools::error::Message| {}, None).map_err(|e| e.to_string())?;
    Ok(result.as_bytes().to_vec())
}

#[cfg(test)]
mod tests {
    use super::*;
    use rspirv::{dr::Builder, spirv};

    /// A function of one product, one float sum and one integer sum; with a name and a line.
    fn module() -> (Vec<u8>, [u32; 3]) {
        let mut b = Builder::new();
        b.set_version(1, 3);
        b.capability(spirv::Capability::Shader);
        b.memory_model(spirv::AddressingModel::Logical, spirv::MemoryModel::Simple);
        let (void, float, int) = (b.type_void(), b.type_float(32, None), b.type_int(32, 0));
        let signature = b.type_function(void, []);
        let (one, two) = (b.constant_bit32(float, 1f32.to_bits()), b.constant_bit32(int, 2));
        let file = b.string("a file");
        let main = b.begin_function(void, None, spirv::FunctionControl::NONE, signature).expect("no function is open");
        b.name(main, "main");
        b.begin_block(None).expect("a function is open");
        b.line(file, 1, 1);
        let product = b.f_mul(float, None, one, one).expect("a block is open");
        let sum = b.f_add(float, None, product, one).expect("a block is open");
        let count = b.i_add(int, None, two, two).expect("a block is open");
        b.ret().expect("a block is open");
        b.end_function().expect("a function is open");
        (bytes(&b.module()), [product, sum, count])
    }

    #[test]
    fn pinning_decorates_float_operations_and_changes_nothing_else() {
        let (source, [product, sum, count]) = module();
        let stripped = load_bytes(stripped(&source).expect("SPIR-V")).expect("SPIR-V");
        let mut pinned = load_bytes(pinned(&source).expect("SPIR-V")).expect("SPIR-V");
        let decorated: Vec<_> = pinned.annotations.iter().map(|i| i.operands[0].unwrap_id_ref()).collect();
        assert_eq!(decorated, [product, sum]);
        assert!(!decorated.contains(&count));
        pinned.annotations.clear();
        assert_eq!(bytes(&pinned), bytes(&stripped));
    }

    #[test]
    fn stripping_takes_names_lines_and_strings() {
        let (source, _) = module();
        let contains = |module: &[u8], text: &str| module.windows(text.len()).any(|w| w == text.as_bytes());
        assert!(contains(&source, "a file") && contains(&source, "main"));
        let stripped = stripped(&source).expect("SPIR-V");
        assert!(!contains(&stripped, "a file") && !contains(&stripped, "main"));
        // Strings in 3 words for each text of 4 to 7 letters with its end, and a line in 4.
        assert_eq!(source.len() - stripped.len(), 4 * (4 + 4 + 4));
    }

    #[test]
    fn a_file_that_is_no_module_is_an_error() {
        assert!(stripped(b"not a module").is_err() && pinned(&[]).is_err());
    }
}
