//! What a SPIR-V module says of itself: bindings by name, push constants, workgroup, size.

use std::collections::HashMap;

use spirq::ReflectConfig;
use spirq::ty::{AccessType, DescriptorType, SpirvType, Type};
use spirq::var::Variable;

/// One resource that a shader binds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Binding {
    /// Its name in GLSL: the block's name for buffers, the variable's for images.
    pub name: String,
    /// Number in descriptor set 0.
    pub number: u32,
    /// What it is and how it is used.
    pub kind: BindingKind,
    /// Of a buffer block: its members.
    pub members: Vec<Member>,
}

/// What a binding holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BindingKind {
    /// A storage buffer, and whether the shader reads and writes it.
    StorageBuffer {
        /// Not declared `writeonly`.
        reads: bool,
        /// Not declared `readonly`.
        writes: bool,
    },
    /// A uniform buffer: read alike by every thread.
    UniformBuffer,
    /// Images whose texels the shader stores and does not read.
    StorageImage {
        /// Elements of the array; 1 for a single image.
        count: u32,
    },
    /// Images with their samplers.
    SampledImage {
        /// Elements of the array; 1 for a single image.
        count: u32,
    },
}

/// A member of a struct that host and shader share.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Member {
    /// Its GLSL name, with a dot for nested structs, and [] for arrays, whose element's members follow.
    pub name: String,
    /// Byte offset from the start of the struct, or of the array's element.
    pub offset: usize,
    /// Bytes; 0 for a runtime array.
    pub bytes: usize,
    /// Bytes from one element to the next; 0 for what is no array.
    pub stride: usize,
}

/// See the module.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Reflection {
    /// Sorted by number.
    pub bindings: Vec<Binding>,
    /// Members of the push constant block.
    pub push: Vec<Member>,
    /// Bytes of the push constant block.
    pub push_bytes: u32,
    /// Threads of one workgroup along x, y, z.
    pub workgroup: [u32; 3],
    /// Instructions inside functions, debug lines left out.
    pub instructions: u32,
}

impl Reflection {
    /// Reads a compute module.
    pub(crate) fn of(spirv: &[u32]) -> Result<Reflection, String> {
        let entries = ReflectConfig::new()
            .spv(spirv.to_vec())
            .combine_img_samplers(true)
            .reflect()
            .map_err(|why| why.to_string())?;
        let entry = entries.into_iter().next().ok_or("no entry point")?;
        let mut bindings = Vec::new();
        let mut push = Vec::new();
        let mut push_bytes = 0;
        for variable in entry.vars {
            match variable {
                Variable::Descriptor { name, desc_bind, desc_ty, ty, nbind } => {
                    let number = desc_bind.bind();
                    let binding = binding_of(name, number, &desc_ty, &ty, nbind)?;
                    bindings.push(binding);
                }
                Variable::PushConstant { ty, .. } => {
                    members_of(&ty, "", 0, &mut push);
                    push_bytes = ty.nbyte().unwrap_or(0) as u32;
                }
                _ => {}
            }
        }
        bindings.sort_by_key(|binding| binding.number);
        let (workgroup, instructions) = scan(spirv)?;
        Ok(Reflection { bindings, push, push_bytes, workgroup, instructions })
    }
}

fn binding_of(
    name: Option<String>,
    number: u32,
    descriptor: &DescriptorType,
    ty: &Type,
    count: u32,
) -> Result<Binding, String> {
    let mut members = Vec::new();
    let (name, kind) = match (descriptor, ty) {
        (DescriptorType::StorageBuffer(access), Type::Struct(block)) => {
            members_of(ty, "", 0, &mut members);
            // glslang puts `readonly` and `writeonly` on each member.
            let of_member = |wanted: AccessType| {
                !block.members.is_empty()
                    && block.members.iter().all(|member| member.access_ty == wanted)
            };
            let read_only = *access == AccessType::ReadOnly || of_member(AccessType::ReadOnly);
            let write_only = *access == AccessType::WriteOnly || of_member(AccessType::WriteOnly);
            let kind = BindingKind::StorageBuffer { reads: !write_only, writes: !read_only };
            (block.name.clone().or(name), kind)
        }
        (DescriptorType::UniformBuffer(), Type::Struct(block)) => {
            members_of(ty, "", 0, &mut members);
            (block.name.clone().or(name), BindingKind::UniformBuffer)
        }
        (DescriptorType::CombinedImageSampler(), _) => {
            (name, BindingKind::SampledImage { count: count.max(1) })
        }
        (DescriptorType::StorageImage(AccessType::WriteOnly), _) => {
            (name, BindingKind::StorageImage { count: count.max(1) })
        }
        (DescriptorType::StorageImage(_), _) => {
            return Err(format!("storage image {number} is not declared writeonly"));
        }
        (other, _) => return Err(format!("binding {number} is a {other:?}, which no pass uses")),
    };
    let name = name.ok_or_else(|| format!("binding {number} has no name"))?;
    Ok(Binding { name, number, kind, members })
}

fn members_of(ty: &Type, prefix: &str, base: usize, members: &mut Vec<Member>) {
    let Type::Struct(block) = ty else { return };
    for member in &block.members {
        let name = member.name.as_deref().unwrap_or("?");
        let name = if prefix.is_empty() { name.to_owned() } else { format!("{prefix}.{name}") };
        let offset = base + member.offset.unwrap_or(0);
        match &member.ty {
            Type::Struct(_) => members_of(&member.ty, &name, offset, members),
            Type::Array(array) => {
                let (bytes, stride) = (array.nbyte().unwrap_or(0), array.stride.unwrap_or(0));
                members.push(Member { name: format!("{name}[]"), offset, bytes, stride });
                members_of(&array.element_ty, "", 0, members);
            }
            other => {
                let bytes = other.nbyte().unwrap_or(0);
                members.push(Member { name, offset, bytes, stride: 0 });
            }
        }
    }
}

/// The workgroup's size and the number of instructions in functions.
fn scan(spirv: &[u32]) -> Result<([u32; 3], u32), String> {
    const MAGIC: u32 = 0x0723_0203;
    const OP_EXECUTION_MODE: u32 = 16;
    const MODE_LOCAL_SIZE: u32 = 17;
    // SPIR-V 1.6 names constants, defined further on, where older versions give numbers.
    const OP_EXECUTION_MODE_ID: u32 = 331;
    const MODE_LOCAL_SIZE_ID: u32 = 38;
    const OP_CONSTANT: u32 = 43;
    const OP_FUNCTION: u32 = 54;
    const OP_FUNCTION_END: u32 = 56;
    const OP_LINE: u32 = 8;
    const OP_NO_LINE: u32 = 317;
    if spirv.first() != Some(&MAGIC) || spirv.len() < 5 {
        return Err("not a SPIR-V module".to_owned());
    }
    let mut workgroup = None;
    let mut workgroup_ids = None;
    let mut constants = HashMap::new();
    let mut instructions = 0;
    let mut inside = false;
    let mut at = 5;
    while at < spirv.len() {
        let words = (spirv[at] >> 16) as usize;
        let Some(instruction) = spirv.get(at..at + words).filter(|_| words > 0) else {
            return Err("the SPIR-V module is cut short".to_owned());
        };
        match spirv[at] & 0xffff {
            OP_EXECUTION_MODE if instruction.get(2) == Some(&MODE_LOCAL_SIZE) && words == 6 => {
                workgroup = Some([instruction[3], instruction[4], instruction[5]]);
            }
            OP_EXECUTION_MODE_ID
                if instruction.get(2) == Some(&MODE_LOCAL_SIZE_ID) && words == 6 =>
            {
                workgroup_ids = Some([instruction[3], instruction[4], instruction[5]]);
            }
            OP_CONSTANT if !inside && words == 4 => {
                constants.insert(instruction[2], instruction[3]);
            }
            OP_FUNCTION => {
                inside = true;
                instructions += 1;
            }
            OP_FUNCTION_END => {
                inside = false;
                instructions += 1;
            }
            OP_LINE | OP_NO_LINE => {}
            _ if inside => instructions += 1,
            _ => {}
        }
        at += words;
    }
    if let Some(ids) = workgroup_ids {
        let [x, y, z] = ids.map(|id| constants.get(&id).copied());
        workgroup = x.zip(y).zip(z).map(|((x, y), z)| [x, y, z]);
    }
    let workgroup = workgroup.ok_or("the SPIR-V module does not say its workgroup's size")?;
    Ok((workgroup, instructions))
}
