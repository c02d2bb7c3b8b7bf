//! Parameters of alarm and classification from the configuration.

use crate::stages::whole_number::whole;
use config::Config;
use perception::alarm::AlarmParameters;
use perception::tracking::classification_schedule::ScheduleParameters;

/// Parameters of the alarm.
pub fn alarm_parameters(config: &Config) -> AlarmParameters {
    let c = &config.alarm;
    AlarmParameters {
        distance_m: c.distance_m,
        distance_s: c.distance_s,
        ttc_warning_s: c.ttc_warning_s,
        ttc_alarm_s: c.ttc_alarm_s,
        deceleration_warning_m_s2: c.deceleration_warning_m_s2,
        deceleration_alarm_m_s2: c.deceleration_alarm_m_s2,
        path_width_m: c.path_width_m,
        front_m: config.vehicle.front_m,
        confirm_frames: whole(c.confirm_frames),
        clear_share: c.clear_share,
        hold_ns: whole::<u64>(c.hold_ms) * 1_000_000,
    }
}

/// Parameters of the classification schedule.
pub fn schedule_parameters(config: &Config) -> ScheduleParameters {
    let c = &config.recognition;
    ScheduleParameters {
        max_per_frame: whole(c.looks_max),
        repeat_frames: whole(c.again_frames),
        ..ScheduleParameters::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_configuration_matches_the_defaults_of_the_algorithms() {
        let config = Config::default();
        assert_eq!(alarm_parameters(&config), AlarmParameters::default());
        assert_eq!(schedule_parameters(&config), ScheduleParameters::default());
    }
}
