//! The distance alarm: on when something in the vehicle's path comes nearer than a preset
//! distance, held for a while (paper, section 4.3).

/// When the alarm sounds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AlarmParameters {
    /// Something nearer than this is dangerous, in metres.
    pub distance_m: f64,
    /// Width of the vehicle's path, in metres; what lies beside it does not count.
    pub path_width_m: f64,
    /// Once on, the alarm stays on for at least this long after its cause is gone.
    pub hold_ns: u64,
}

impl Default for AlarmParameters {
    fn default() -> Self {
        Self { distance_m: 10.0, path_width_m: 2.4, hold_ns: 1_000_000_000 }
    }
}

/// What the alarm says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AlarmLevel {
    /// The system cannot judge (degraded, or no road seen).
    Off,
    /// Nothing dangerous is known.
    Clear,
    /// Something in the path is nearer than the preset distance.
    Alarm,
}

/// A confirmed obstacle, as the alarm sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// Its track.
    pub track: u32,
    /// Distance, in metres.
    pub distance_m: f64,
    /// Its middle, metres right of the vehicle's axis.
    pub lateral_m: f64,
    /// Its width, in metres.
    pub width_m: f64,
}

/// The alarm, and why.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AlarmState {
    /// What it says.
    pub level: AlarmLevel,
    /// The track that caused it, while it is on.
    pub track: Option<u32>,
    /// Nearest obstacle in the path, in metres, whether or not it is dangerous.
    pub nearest_m: Option<f64>,
}

/// The alarm as a state machine; time is passed in.
#[derive(Clone, Debug)]
pub struct Alarm {
    parameters: AlarmParameters,
    /// Cause and end of the hold.
    on: Option<(u32, u64)>,
    last_ns: u64,
}

impl Alarm {
    /// A silent alarm.
    pub fn new(parameters: AlarmParameters) -> Self {
        Self { parameters, on: None, last_ns: 0 }
    }

    /// Whether any part of the candidate lies in the path.
    pub fn in_path(&self, candidate: &Candidate) -> bool {
        candidate.lateral_m.abs() - candidate.width_m / 2.0 < self.parameters.path_width_m / 2.0
    }

    /// Judges one frame. With `able` false the alarm is off, whatever was seen. A time that goes
    /// back is a new recording: nothing is held over.
    pub fn update(
        &mut self,
        time_ns: u64,
        able: bool,
        candidates: impl IntoIterator<Item = Candidate>,
    ) -> AlarmState {
        if time_ns < self.last_ns {
            self.on = None;
        }
        self.last_ns = time_ns;
        if !able {
            self.on = None;
            return AlarmState { level: AlarmLevel::Off, track: None, nearest_m: None };
        }
        let mut nearest: Option<Candidate> = None;
        for candidate in candidates {
            if self.in_path(&candidate) && nearest.is_none_or(|n| candidate.distance_m < n.distance_m) {
                nearest = Some(candidate);
            }
        }
        if let Some(cause) = nearest.filter(|n| n.distance_m < self.parameters.distance_m) {
            self.on = Some((cause.track, time_ns.saturating_add(self.parameters.hold_ns)));
        } else if self.on.is_some_and(|(_, until)| time_ns >= until) {
            self.on = None;
        }
        AlarmState {
            level: if self.on.is_some() { AlarmLevel::Alarm } else { AlarmLevel::Clear },
            track: self.on.map(|(track, _)| track),
            nearest_m: nearest.map(|n| n.distance_m),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(distance_m: f64, lateral_m: f64) -> Candidate {
        Candidate { track: 7, distance_m, lateral_m, width_m: 1.8 }
    }

    fn alarm() -> Alarm {
        Alarm::new(AlarmParameters { distance_m: 10.0, path_width_m: 2.4, hold_ns: 100 })
    }

    #[test]
    fn it_sounds_at_the_preset_distance_and_holds() {
        let mut alarm = alarm();
        assert_eq!(alarm.update(0, true, [at(10.1, 0.0)]).level, AlarmLevel::Clear);
        let state = alarm.update(10, true, [at(30.0, 0.0), at(9.9, 0.5)]);
        assert_eq!((state.level, state.track, state.nearest_m), (AlarmLevel::Alarm, Some(7), Some(9.9)));
        // Gone, but held until 110.
        assert_eq!(alarm.update(109, true, []).level, AlarmLevel::Alarm);
        assert_eq!(alarm.update(110, true, []).level, AlarmLevel::Clear);
        // A recording that starts anew holds nothing over.
        alarm.update(5_000, true, [at(5.0, 0.0)]);
        assert_eq!(alarm.update(0, true, []).level, AlarmLevel::Clear);
    }

    #[test]
    fn what_stands_beside_the_path_does_not_count() {
        let mut alarm = alarm();
        // A car 1.8 m wide touches a path 2.4 m wide from 2.1 m on.
        assert_eq!(alarm.update(0, true, [at(5.0, 2.2), at(5.0, -2.2)]).level, AlarmLevel::Clear);
        assert_eq!(alarm.update(0, true, [at(5.0, -2.0)]).level, AlarmLevel::Alarm);
    }

    #[test]
    fn it_is_off_when_the_system_cannot_judge() {
        let mut alarm = alarm();
        alarm.update(0, true, [at(5.0, 0.0)]);
        let state = alarm.update(1, false, [at(5.0, 0.0)]);
        assert_eq!((state.level, state.nearest_m), (AlarmLevel::Off, None));
        assert_eq!(alarm.update(2, true, []).level, AlarmLevel::Clear);
    }
}
