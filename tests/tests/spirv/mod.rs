//! Questions about a SPIR-V module.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use rspirv::{
    dr::{Instruction, Module, Operand},
    spirv::{Decoration, ExecutionMode, Op, StorageClass},
};

/// A module with its definitions and decorations by id.
pub struct Reader<'a> {
    module: &'a Module,
    definitions: HashMap<u32, &'a Instruction>,
    decorations: HashMap<(u32, Decoration), Option<u32>>,
    offsets: BTreeMap<(u32, u32), u32>,
}

/// An array that fills a buffer.
pub struct Array {
    /// Bytes from one element to the next.
    pub stride: u32,
    /// What it is of.
    pub element: Element,
}

/// An element of a buffer.
#[derive(Debug)]
pub enum Element {
    /// A structure, by id.
    Structure(u32),
    /// A number or a vector.
    Numbers {
        /// Size.
        bytes: u32,
    },
}

impl<'a> Reader<'a> {
    /// Indexes a module.
    pub fn new(module: &'a Module) -> Self {
        let definitions = module.all_inst_iter().filter_map(|i| Some((i.result_id?, i))).collect();
        let mut decorations = HashMap::new();
        let mut offsets = BTreeMap::new();
        for instruction in &module.annotations {
            match instruction.operands[..] {
                [Operand::IdRef(id), Operand::Decoration(what)] => {
                    decorations.insert((id, what), None);
                }
                [Operand::IdRef(id), Operand::Decoration(what), Operand::LiteralBit32(value)] => {
                    decorations.insert((id, what), Some(value));
                }
                [
                    Operand::IdRef(id),
                    Operand::LiteralBit32(member),
                    Operand::Decoration(Decoration::Offset),
                    Operand::LiteralBit32(offset),
                ] => {
                    offsets.insert((id, member), offset);
                }
                _ => {}
            }
        }
        Self { module, definitions, decorations, offsets }
    }

    /// Function and name of each entry point.
    pub fn entry_points(&self) -> impl Iterator<Item = (u32, &'a str)> {
        self.module.entry_points.iter().map(|i| (i.operands[1].unwrap_id_ref(), i.operands[2].unwrap_literal_string()))
    }

    /// The numbers of an execution mode of an entry point.
    pub fn execution_mode(&self, function: u32, mode: ExecutionMode) -> Option<Vec<u32>> {
        let is_it = |i: &&Instruction| i.operands[..2] == [Operand::IdRef(function), Operand::ExecutionMode(mode)];
        let found = self.module.execution_modes.iter().find(is_it)?;
        Some(found.operands[2..].iter().map(Operand::unwrap_literal_bit32).collect())
    }

    /// Global variables that a function uses, itself or through those it calls.
    pub fn globals_of(&self, function: u32) -> BTreeSet<u32> {
        let mut globals = BTreeSet::new();
        let mut seen = BTreeSet::from([function]);
        let mut to_visit = vec![function];
        while let Some(id) = to_visit.pop() {
            let function = self.module.functions.iter().find(|f| f.def_id() == Some(id)).expect("a defined function");
            let operands = function.blocks.iter().flat_map(|b| &b.instructions).flat_map(|i| &i.operands);
            for id in operands.filter_map(Operand::id_ref_any) {
                match self.definitions.get(&id).map(|i| (i.class.opcode, &i.operands)) {
                    Some((Op::Function, _)) if seen.insert(id) => to_visit.push(id),
                    Some((Op::Variable, o)) if o[0] != Operand::StorageClass(StorageClass::Function) => {
                        globals.insert(id);
                    }
                    _ => {}
                }
            }
        }
        globals
    }

    /// The variable in the uniform storage class.
    pub fn uniform(&self) -> Option<u32> {
        let class = Operand::StorageClass(StorageClass::Uniform);
        let mut variables = self.module.types_global_values.iter().filter(|i| i.class.opcode == Op::Variable);
        variables.find(|i| i.operands[0] == class)?.result_id
    }

    /// Storage class of a variable.
    pub fn storage_class(&self, variable: u32) -> StorageClass {
        self.definitions[&variable].operands[0].unwrap_storage_class()
    }

    /// Whether a variable is an acceleration structure.
    pub fn is_acceleration_structure(&self, variable: u32) -> bool {
        let pointer = self.definitions[&variable].result_type;
        let pointee = pointer.and_then(|id| self.definitions[&id].operands[1].id_ref_any());
        pointee.is_some_and(|id| self.definitions[&id].class.opcode == Op::TypeAccelerationStructureKHR)
    }

    /// Whether an id has a decoration.
    pub fn has_decoration(&self, id: u32, what: Decoration) -> bool {
        self.decorations.contains_key(&(id, what))
    }

    /// The number of a decoration of an id.
    pub fn decoration(&self, id: u32, what: Decoration) -> Option<u32> {
        *self.decorations.get(&(id, what))?
    }

    /// The structure or array that is the only member, at offset 0, of the block that a variable points to.
    pub fn block(&self, variable: u32) -> Option<u32> {
        let pointer = self.definitions[&variable].result_type?;
        let block = self.definitions[&pointer].operands[1].id_ref_any()?;
        let [ref member] = self.definitions[&block].operands[..] else { return None };
        (self.has_decoration(block, Decoration::Block) && self.offsets.get(&(block, 0)) == Some(&0)).then_some(())?;
        member.id_ref_any()
    }

    /// The structure that a variable points to.
    pub fn pointee(&self, variable: u32) -> Option<u32> {
        let pointer = self.definitions[&variable].result_type?;
        let pointee = self.definitions[&pointer].operands[1].id_ref_any()?;
        // rust-gpu may wrap it into a block of its own.
        let members = self.member_types(pointee);
        match members[..] {
            [(0, inner)] if self.definitions[&inner].class.opcode == Op::TypeStruct => Some(inner),
            _ => Some(pointee),
        }
    }

    /// The unsized array that fills the block of a storage buffer.
    pub fn array_block(&self, variable: u32) -> Option<Array> {
        let array = self.block(variable)?;
        let definition = self.definitions[&array];
        (definition.class.opcode == Op::TypeRuntimeArray).then_some(())?;
        let element = definition.operands[0].id_ref_any()?;
        let element = match self.definitions[&element].class.opcode {
            Op::TypeStruct => Element::Structure(element),
            Op::TypeVector => {
                Element::Numbers { bytes: 4 * self.definitions[&element].operands[1].unwrap_literal_bit32() }
            }
            _ => Element::Numbers { bytes: 4 },
        };
        Some(Array { stride: self.decoration(array, Decoration::ArrayStride)?, element })
    }

    /// Offset and shape of every member of a structure.
    pub fn members(&self, structure: u32) -> Vec<(u32, String)> {
        let types = self.definitions[&structure].operands.iter().filter_map(Operand::id_ref_any);
        let member = |(i, id)| (self.offsets.get(&(structure, i)).copied().unwrap_or(u32::MAX), self.shape(id));
        (0..).zip(types).map(member).collect()
    }

    /// Offset and type of every member of a structure.
    pub fn member_types(&self, structure: u32) -> Vec<(u32, u32)> {
        let types = self.definitions[&structure].operands.iter().filter_map(Operand::id_ref_any);
        (0..).zip(types).map(|(i, id)| (self.offsets.get(&(structure, i)).copied().unwrap_or(u32::MAX), id)).collect()
    }

    /// A type in the words of Rust; vectors as `f32x3`.
    fn shape(&self, id: u32) -> String {
        let definition = self.definitions[&id];
        let element = |n: usize| self.shape(definition.operands[n].unwrap_id_ref());
        match definition.class.opcode {
            Op::TypeInt => "u32".into(),
            Op::TypeFloat => "f32".into(),
            Op::TypeVector => format!("{}x{}", element(0), definition.operands[1].unwrap_literal_bit32()),
            Op::TypeArray => {
                let length = self.definitions[&definition.operands[1].unwrap_id_ref()];
                let (element, length) = (element(0), length.operands[0].unwrap_literal_bit32());
                let dense = if element.ends_with("x4") { 16 } else { 4 };
                match self.decoration(id, Decoration::ArrayStride) {
                    Some(stride) if stride == dense => format!("[{element}; {length}]"),
                    stride => format!("[{element}; {length}] of stride {stride:?}"),
                }
            }
            other => format!("{other:?}"),
        }
    }

    /// The value of a float literal.
    pub fn float(&self, constant: &Instruction) -> Option<f32> {
        let definition = self.definitions[&constant.result_type?];
        (definition.class.opcode == Op::TypeFloat).then(|| f32::from_bits(constant.operands[0].unwrap_literal_bit32()))
    }
}
