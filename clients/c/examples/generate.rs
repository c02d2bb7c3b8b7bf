//! Writes what is generated from the declarations of the records: the C header, the Python module, the reference.

#[path = "../generator/mod.rs"]
mod generator;

fn main() -> std::io::Result<()> {
    for (path, text) in generator::all() {
        std::fs::write(generator::root().join(path), text)?;
        println!("{path}");
    }
    Ok(())
}
