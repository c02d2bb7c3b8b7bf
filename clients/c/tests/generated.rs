//! What is generated is that of today's declarations.

#[path = "../generator/mod.rs"]
mod generator;

#[test]
fn header_python_module_and_reference_are_those_of_the_declarations() {
    for (path, text) in generator::all() {
        let there = std::fs::read_to_string(generator::root().join(path)).unwrap_or_default();
        assert!(there == text, "{path} is out of date: cargo run -p lookout-client-c --example generate");
        assert!(!text.contains("crate::") && !text.contains("[`"), "{path}: a link that only rustdoc knows");
    }
}

#[test]
fn sizes_of_the_declarations_are_those_of_the_compiler() {
    let structures = generator::structures();
    for record in messages::layout::records() {
        let structure = structures.iter().find(|structure| structure.rust == record.name).expect("declared");
        assert_eq!(structure.bytes(&structures), record.bytes, "{}", record.name);
        let names: Vec<&str> = structure.fields.iter().map(|field| &field.name[..]).collect();
        let declared: Vec<&str> = record.fields.iter().map(|(name, _)| *name).collect();
        assert_eq!(names, declared, "{}", record.name);
        for field in &structure.fields {
            assert!(field.docs.len() > 2, "{}: {} is not documented", record.name, field.name);
        }
    }
    let bytes = |rust: &str| structures.iter().find(|s| s.rust == rust).expect("declared").bytes(&structures);
    assert_eq!(bytes("LookoutFrame"), size_of::<lookout::LookoutFrame>());
    assert_eq!(bytes("LookoutOptions"), size_of::<lookout::LookoutOptions>());
}
