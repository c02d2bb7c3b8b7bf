//! The records that clients read, for generated documentation and headers: sizes, and the valid values of each field.

use crate::motion::{MotionRecord, VehicleRecord};
use crate::obstacles::{AlarmRecord, ObstacleRecord};
use crate::range::Ranged;
use crate::rig::RigRecord;
use crate::space::{BoundaryPointRecord, BoundaryRecord, SectorRecord, SpaceRecord};

/// A record.
#[derive(Clone, Debug)]
pub struct RecordLayout {
    /// Name of its type.
    pub name: &'static str,
    /// Its size, in bytes.
    pub bytes: usize,
    /// Names of its fields in their order, and their valid values in words; `None` where every value is valid, or the
    /// field is a record of its own.
    pub fields: Vec<(&'static str, Option<String>)>,
}

fn of<T: Ranged>(name: &'static str) -> RecordLayout {
    RecordLayout { name, bytes: size_of::<T>(), fields: T::texts() }
}

/// The records, each after those that it contains.
pub fn records() -> Vec<RecordLayout> {
    vec![
        of::<SectorRecord>("SectorRecord"),
        of::<BoundaryPointRecord>("BoundaryPointRecord"),
        of::<BoundaryRecord>("BoundaryRecord"),
        of::<SpaceRecord>("SpaceRecord"),
        of::<AlarmRecord>("AlarmRecord"),
        of::<ObstacleRecord>("ObstacleRecord"),
        of::<MotionRecord>("MotionRecord"),
        of::<VehicleRecord>("VehicleRecord"),
        of::<RigRecord>("RigRecord"),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_record_names_its_fields_and_ranges() {
        let records = records();
        assert_eq!(records.len(), 9);
        let alarm = records.iter().find(|record| record.name == "AlarmRecord").unwrap();
        let text = |name| &alarm.fields.iter().find(|(field, _)| *field == name).unwrap().1;
        assert_eq!(text("level").as_deref(), Some("0 to 3"));
        assert_eq!(text("nearest_m").as_deref(), Some("0 to 10000, or infinite"));
        assert_eq!((text("track"), text("space"), text("class")), (&None, &None, &None));
    }
}
