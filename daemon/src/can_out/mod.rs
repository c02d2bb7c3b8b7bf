//! CAN out: a process of its own that reads results and status as any other reader and sends them on a CAN bus.
//!
//! The scheduler does not know of it, so a bus that is full, off or missing can disturb no stage. A thread follows the
//! daemon across its runs and keeps its newest values; another sends them at a fixed period, also while no daemon runs.
//! [`state_file`] tells `lookout status` how the bus does.

#[cfg(feature = "can")]
pub mod sender;
#[cfg(feature = "can")]
mod shared;
pub mod state_file;
#[cfg(any(feature = "can", test))]
mod values;
#[cfg(feature = "can")]
pub mod watcher;

#[cfg(feature = "can")]
pub use shared::Shared;

use crate::command::CommandError;
use crate::stages::whole_number::whole;
use config::Config;
use tools::can_out::{ID_COUNT, Identifiers, is_diagnostic};

/// Maximum standard identifier.
const MAX_STANDARD_ID: i64 = 0x7ff;

/// The identifiers that the configuration gives.
///
/// # Errors
/// If they are too large, or those of diagnostics.
pub fn identifiers(config: &Config) -> Result<Identifiers, CommandError> {
    let c = &config.can_out;
    let base = whole::<u32>(c.base_id);
    if !is_diagnostic(base, c.extended_ids) {
        return Ok(Identifiers { base, is_extended: c.extended_ids, objects: whole(c.objects) });
    }
    let remedy = if !c.extended_ids && c.base_id > MAX_STANDARD_ID {
        "give at most 0x7bf, or set can_out.extended_ids"
    } else {
        "choose others: 0x7df to 0x7ef, and 0x18da0000 to 0x18dbffff, belong to diagnostics (ISO 15765-4)"
    };
    Err(CommandError::Other(format!(
        "can_out.base_id = {base:#x}: the {ID_COUNT} identifiers from there on cannot be used: {remedy}"
    )))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn identifiers_that_cannot_be_used_are_refused_with_a_remedy() {
        let of = |keys: &str| {
            let config = config::parse(&format!("[can_out]\n{keys}"), Path::new("car.toml")).unwrap();
            identifiers(&config).map_err(|error| error.to_string())
        };
        let default = Identifiers { base: tools::can_out::DEFAULT_BASE_ID, is_extended: false, objects: 8 };
        assert_eq!(of("").unwrap(), default);
        assert!(of("base_id = 0x800").unwrap_err().contains("set can_out.extended_ids"));
        assert!(of("base_id = 0x7e0").unwrap_err().contains("can_out.base_id = 0x7e0"));
        assert!(of("base_id = 0x18da0000\nextended_ids = true").unwrap_err().contains("ISO 15765-4"));
        assert!(of("base_id = 0x800\nextended_ids = true\nobjects = 0").is_ok());
    }
}
