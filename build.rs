//! Completes the static link of shaderc on systems that ship glslang and SPIRV-Tools apart from it.
//!
//! Debian's `libshaderc_static.a` holds shaderc alone; its shared library has undefined symbols.
//! Where the folder named by SHADERC_LIB_DIR has the parts, they are linked; elsewhere nothing is added.

use std::path::Path;

/// What shaderc stands on, in link order: each needs those after it.
const PARTS: [&str; 9] = [
    "glslang",
    "MachineIndependent",
    "GenericCodeGen",
    "SPIRV",
    "HLSL",
    "OGLCompiler",
    "OSDependent",
    "glslang-default-resource-limits",
    "SPIRV-Tools-opt",
];

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-env-changed=SHADERC_LIB_DIR");
    let Ok(folder) = std::env::var("SHADERC_LIB_DIR") else { return };
    let has = |part: &str| Path::new(&folder).join(format!("lib{part}.a")).exists();
    if !has("shaderc_static") || !has("MachineIndependent") {
        return;
    }
    for part in PARTS.iter().chain(&["SPIRV-Tools"]).filter(|part| has(part)) {
        println!("cargo::rustc-link-arg=-l{part}");
    }
}
