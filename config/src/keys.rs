//! All keys of the configuration, as their tables declare them.

pub use crate::key::{Key, Kind, Reload, Table};
use std::sync::LazyLock;

static TABLES: LazyLock<Vec<Table>> = LazyLock::new(crate::tables::declared);

/// All tables, in the order of the reference page.
pub fn tables() -> &'static [Table] {
    &TABLES
}

static DETECTORS: LazyLock<Vec<Key>> = LazyLock::new(|| {
    <crate::tables::RecognitionDetector as crate::table::Table>::keys("recognition.detectors")
});

/// The keys of each table of the list `recognition.detectors`.
pub fn detectors() -> &'static [Key] {
    &DETECTORS
}

/// All keys, table by table.
pub fn all() -> impl Iterator<Item = &'static Key> {
    tables().iter().flat_map(|table| &table.keys)
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::pipeline::PROCESSES;

    #[test]
    fn each_table_that_restarts_its_readers_has_some() {
        for key in all().filter(|key| key.reload == Reload::Readers) {
            assert!(key.restarts().next().is_some(), "no stage reads [{}]", key.table);
        }
        for table in PROCESSES.iter().flat_map(|stage| stage.config_tables) {
            assert!(tables().iter().any(|known| known.name == *table), "[{table}] is no table");
        }
    }
}
