//! How the shared library is linked.

const PIPELINE: &str = "../../ipc/src/pipeline.rs";

fn main() {
    let pipeline = std::fs::read_to_string(PIPELINE).expect("the declaration of the messages is there");
    let rest = pipeline.split_once("pub const VERSION: u16 = ").expect("it declares its version").1;
    let version = rest.split_once(';').expect("it is a statement").0;
    // A program that was linked with another layout of the structures does not start with this library.
    println!("cargo:rustc-cdylib-link-arg=-Wl,-soname,liblookout.so.{version}");
    // The library's own ftruncate and fsync (ipc/src/free_memory.rs, file_sync.rs) are for the library, also where a program loads it
    // with dlopen.
    println!("cargo:rustc-cdylib-link-arg=-Wl,-Bsymbolic-functions");
    println!("cargo:rerun-if-changed={PIPELINE}");
    println!("cargo:rerun-if-changed=build.rs");
}
