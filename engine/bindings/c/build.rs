//! Names the shared library by the version of its ABI, so that a program finds the one that it was made for.

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    if std::env::var("CARGO_CFG_TARGET_OS").is_ok_and(|system| system == "linux") {
        println!("cargo:rustc-cdylib-link-arg=-Wl,-soname,libswarmwright.so.1");
    }
}
