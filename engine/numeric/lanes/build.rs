//! Selects the instruction sets for which kernels are compiled.
//!
//! They are compiled once more for each of them. `SWARMWRIGHT_LEVELS=native` compiles large ones for the best one of this processor
//! alone: what runs elsewhere, as binaries do that are handed on, is compiled for all.

use std::env;

const LEVELS: &str = "SWARMWRIGHT_LEVELS";

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-env-changed={LEVELS}");
    let all = ["portable", "avx2", "avx512"];
    for level in all {
        println!("cargo::rustc-check-cfg=cfg(level_{level})");
    }
    let value = env::var(LEVELS).unwrap_or_default();
    let is_for_here = env::var("HOST") == env::var("TARGET");
    let levels = match value.as_str() {
        "native" if is_for_here => vec![best()],
        "" | "all" | "native" => all.to_vec(),
        _ => {
            println!("cargo::error={LEVELS}={value}: expected all or native");
            return;
        }
    };
    for level in levels {
        println!("cargo::rustc-cfg=level_{level}");
    }
}

/// The best instruction set of this processor, as `Level::of_processor` finds it.
#[cfg(target_arch = "x86_64")]
fn best() -> &'static str {
    let has_avx512 = is_x86_feature_detected!("avx512f")
        && is_x86_feature_detected!("avx512bw")
        && is_x86_feature_detected!("avx512dq")
        && is_x86_feature_detected!("avx512vl")
        && is_x86_feature_detected!("popcnt");
    if has_avx512 {
        "avx512"
    } else if is_x86_feature_detected!("avx2") {
        "avx2"
    } else {
        "portable"
    }
}

#[cfg(not(target_arch = "x86_64"))]
fn best() -> &'static str {
    "portable"
}
