//! Shader variants: GLSL and macro definitions in, SPIR-V out, cached on disk by content.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use xxhash_rust::xxh3::xxh3_128;

use crate::error::{Error, Result};
use crate::gpu::reflection::Reflection;

/// GLSL sources by name, as `march.comp` or `common/exponential.glsl`.
pub type ShaderSources = [(&'static str, &'static str)];

/// A shader and the macros that shape it. What a scene lacks is not defined, so not compiled.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Variant {
    /// The shader's name without `.comp`.
    pub shader: &'static str,
    /// Macro names and values, in a fixed order.
    pub defines: Vec<(String, String)>,
}

impl Variant {
    /// A variant without macros.
    pub fn plain(shader: &'static str) -> Variant {
        Variant { shader, defines: Vec::new() }
    }

    /// Adds a macro.
    #[must_use]
    pub fn define(mut self, name: impl Into<String>, value: impl ToString) -> Variant {
        self.defines.push((name.into(), value.to_string()));
        self
    }
}

/// Compiled SPIR-V and what it says of itself.
#[derive(Clone, Debug)]
pub struct Shader {
    /// What it was made from.
    pub variant: Variant,
    /// The module.
    pub spirv: Vec<u32>,
    /// Bindings, push constants and workgroup, read from the module.
    pub reflection: Reflection,
}

/// Compiles variants, keeping SPIR-V in a folder so that it is made once per content.
pub struct ShaderCompiler {
    sources: &'static ShaderSources,
    cache: Option<PathBuf>,
    // Made at the first miss: starting shaderc takes longer than reading the cache.
    shaderc: Mutex<Option<shaderc::Compiler>>,
    /// By the key of their files: a change of scene asks for all of its variants again.
    known: Mutex<HashMap<u128, Shader>>,
}

/// Variants kept in memory at most: some hundred KB each.
const KNOWN_MAX: usize = 256;

/// Raised when compile options change, so that old cache entries are not taken for new ones.
const CACHE_VERSION: u32 = 1;
/// Ends every cache file: the 16-byte hash of what comes before it.
const CACHE_CHECK_BYTES: usize = 16;

impl ShaderCompiler {
    /// A compiler over embedded sources; `cache` is a folder, made when needed.
    pub fn new(sources: &'static ShaderSources, cache: Option<PathBuf>) -> ShaderCompiler {
        ShaderCompiler { sources, cache, shaderc: Mutex::new(None), known: Mutex::default() }
    }

    /// The usual cache folder of this user, if the environment names one.
    pub fn user_cache() -> Option<PathBuf> {
        let home = || std::env::var_os("HOME").map(|home| Path::new(&home).join(".cache"));
        std::env::var_os("XDG_CACHE_HOME")
            .map(PathBuf::from)
            .filter(|path| path.is_absolute())
            .or_else(home)
            .map(|folder| folder.join("ashfall").join("spirv"))
    }

    /// SPIR-V of a variant, from the cache or compiled.
    ///
    /// # Errors
    /// Exit code 1 when our own GLSL does not compile (a bug), with the compiler's words.
    pub fn compile(&self, variant: &Variant) -> Result<Shader> {
        let key = self.key(variant)?;
        let known = || self.known.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(shader) = known().get(&key) {
            return Ok(shader.clone());
        }
        let file = self.cache.as_ref().map(|folder| folder.join(format!("{key:032x}.spv")));
        let cached = file.as_deref().and_then(read_cached);
        let spirv = match cached {
            Some(spirv) => spirv,
            None => {
                let spirv = self.compile_glsl(variant)?;
                if let Some(file) = &file {
                    // A cache that cannot be written costs time, nothing else.
                    let _ = write_cached(file, &spirv);
                }
                spirv
            }
        };
        let reflection = Reflection::of(&spirv)
            .map_err(|why| bug(format!("shader {}: {why}", variant.shader)))?;
        let shader = Shader { variant: variant.clone(), spirv, reflection };
        let mut known = known();
        if known.len() == KNOWN_MAX {
            known.clear();
        }
        known.insert(key, shader.clone());
        Ok(shader)
    }

    fn source(&self, name: &str) -> Result<&'static str> {
        self.sources
            .iter()
            .find(|(known, _)| *known == name)
            .map(|(_, text)| *text)
            .ok_or_else(|| bug(format!("shader source {name} is not embedded")))
    }

    /// Hash of everything the SPIR-V depends on. All common files count: few and small.
    fn key(&self, variant: &Variant) -> Result<u128> {
        let mut text = format!("{CACHE_VERSION} {:?}\n", shaderc::get_spirv_version());
        for (name, value) in &variant.defines {
            text += &format!("#define {name} {value}\n");
        }
        text += self.source(&format!("{}.comp", variant.shader))?;
        for (name, source) in self.sources.iter().filter(|(name, _)| name.starts_with("common/")) {
            text += name;
            text += source;
        }
        Ok(xxh3_128(text.as_bytes()))
    }

    fn compile_glsl(&self, variant: &Variant) -> Result<Vec<u32>> {
        let name = format!("{}.comp", variant.shader);
        let source = self.source(&name)?;
        let failed = |why: shaderc::Error| bug(format!("shader {name} does not compile: {why}"));
        let mut options = shaderc::CompileOptions::new().map_err(failed)?;
        options.set_target_env(shaderc::TargetEnv::Vulkan, shaderc::EnvVersion::Vulkan1_3 as u32);
        options.set_optimization_level(shaderc::OptimizationLevel::Performance);
        // Keeps names in the optimized module: bindings go by name.
        options.set_generate_debug_info();
        options.set_auto_bind_uniforms(true);
        options.set_warnings_as_errors();
        for (macro_name, value) in &variant.defines {
            options.add_macro_definition(macro_name, Some(value));
        }
        options.set_include_callback(|requested, _, _, _| {
            let content = self.source(requested).map_err(|why| why.message)?.to_owned();
            Ok(shaderc::ResolvedInclude { resolved_name: requested.to_owned(), content })
        });
        let mut shaderc = self.shaderc.lock().unwrap_or_else(PoisonError::into_inner);
        if shaderc.is_none() {
            *shaderc = Some(shaderc::Compiler::new().map_err(failed)?);
        }
        let Some(compiler) = shaderc.as_ref() else { return Err(bug("shaderc vanished")) };
        let artifact = compiler
            .compile_into_spirv(source, shaderc::ShaderKind::Compute, &name, "main", Some(&options))
            .map_err(failed)?;
        Ok(artifact.as_binary().to_vec())
    }
}

fn bug(message: impl Into<String>) -> Error {
    Error { exit: crate::error::Exit::Bug, message: message.into() }
}

fn read_cached(file: &Path) -> Option<Vec<u32>> {
    let bytes = std::fs::read(file).ok()?;
    let body = bytes.len().checked_sub(CACHE_CHECK_BYTES)?;
    let (spirv, check) = bytes.split_at(body);
    let whole = xxh3_128(spirv).to_le_bytes() == check && spirv.len() % 4 == 0;
    let word = |bytes: &[u8]| u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
    whole.then(|| spirv.chunks_exact(4).map(word).collect())
}

fn write_cached(file: &Path, spirv: &[u32]) -> std::io::Result<()> {
    let folder = file.parent().unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder)?;
    let mut bytes: Vec<u8> = spirv.iter().flat_map(|word| word.to_le_bytes()).collect();
    bytes.extend(xxh3_128(&bytes).to_le_bytes());
    // Written aside and renamed: another process may read or write the same entry.
    let partial = file.with_extension(format!("partial-{}", std::process::id()));
    std::fs::write(&partial, &bytes)?;
    std::fs::rename(&partial, file)
}

#[cfg(test)]
mod tests {
    use super::*;

    static SOURCES: &ShaderSources = &[(
        "double.comp",
        "#version 460\nlayout(local_size_x = WIDTH) in;\n\
         layout(std430) buffer Numbers { float numbers[]; };\n\
         void main() { numbers[gl_GlobalInvocationID.x] *= 2.0; }",
    )];

    #[test]
    fn variants_are_cached_by_content_and_damage_is_noticed() {
        let folder = std::env::temp_dir().join(format!("ashfall-spirv-{}", std::process::id()));
        let compiler = ShaderCompiler::new(SOURCES, Some(folder.clone()));
        let variant = Variant::plain("double").define("WIDTH", 8);
        let first = compiler.compile(&variant).expect("compiles");
        assert_eq!(first.reflection.workgroup, [8, 1, 1]);
        compiler.compile(&Variant::plain("double").define("WIDTH", 16)).expect("compiles");
        let files: Vec<_> =
            std::fs::read_dir(&folder).expect("cache").flatten().map(|f| f.path()).collect();
        assert_eq!(files.len(), 2);
        for file in &files {
            std::fs::write(file, b"damaged beyond recognition").expect("write");
        }
        let another = ShaderCompiler::new(SOURCES, Some(folder.clone()));
        assert_eq!(another.compile(&variant).expect("compiles anew").spirv, first.spirv);
        // What a compiler knows it needs no file for.
        std::fs::remove_dir_all(&folder).expect("clean up");
        assert_eq!(compiler.compile(&variant).expect("known").spirv, first.spirv);
        assert!(!folder.exists(), "compiled again");
    }
}
