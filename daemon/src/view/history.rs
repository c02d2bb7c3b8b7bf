//! History of the last minutes, one sample per second, for the charts of a page that has just been opened.

use super::board::{Reading, Readings};
use messages::header::Header;
use messages::pipeline::{PATH_LENGTH, Role};
use messages::status::StatusRecord;
use serde::Serialize;
use std::collections::VecDeque;

/// Number of samples that are kept, one per second.
const KEPT: usize = 300;

/// One second. Times are in milliseconds, processes in the order of [`messages::pipeline::PATH`].
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Sample {
    /// Number of the sample, counted from 0.
    pub number: u64,
    /// Seconds since 1970.
    pub time_s: f64,
    /// Frames per second of the last stage; `None` if it did not run.
    pub rate_hz: Option<f32>,
    /// Mean latency from capture to obstacles; `None` if there was no frame.
    pub latency_ms: Option<f64>,
    /// Longest latency from capture to obstacles.
    pub latency_worst_ms: Option<f64>,
    /// Mean work of each stage.
    pub stage_ms: Option<[f64; PATH_LENGTH]>,
    /// Frames dropped in this second: replaced by newer ones before a stage took them, over all stages.
    pub dropped: u64,
    /// Processor time of all processes, in percent of one core.
    pub cpu_percent: f32,
    /// Own speed, in m/s; `None` while it is unknown.
    pub speed_m_s: Option<f64>,
    /// Own yaw rate, in rad/s, to the left positive; `None` while it is unknown.
    pub yaw_rate_rad_s: Option<f64>,
    /// `starting`, `running`, `degraded` or `stopping`.
    pub state: &'static str,
    /// `off`, `unknown`, `good` or `degraded`.
    pub calibration: &'static str,
    /// Rung of the thermal ladder; `None` if no temperature is monitored.
    pub rung: Option<&'static str>,
    /// Temperatures, in degrees Celsius.
    pub temperatures: Vec<Reading>,
    /// Clocks, in hertz.
    pub clocks: Vec<Reading>,
}

/// Aggregates frames into samples of one second.
#[derive(Clone, Debug, Default)]
pub struct History {
    samples: VecDeque<Sample>,
    next: u64,
    frames: u32,
    latency_ms: f64,
    latency_worst_ms: f64,
    stage_ms: [f64; PATH_LENGTH],
    dropped: Option<u64>,
}

impl History {
    /// Adds the times of a frame that the last stage has finished.
    pub fn frame(&mut self, header: &Header) {
        let ms = |from: u64, to: u64| to.saturating_sub(from) as f64 * 1e-6;
        let latency_ms = ms(header.capture_ns, header.result_ns());
        self.frames += 1;
        self.latency_ms += latency_ms;
        self.latency_worst_ms = self.latency_worst_ms.max(latency_ms);
        for (sum, stamp) in self.stage_ms.iter_mut().zip(&header.stamps) {
            *sum += ms(stamp.begin_ns, stamp.end_ns);
        }
    }

    /// Completes a sample with the daemon's status, which is sent once a second.
    pub fn second(&mut self, status: &StatusRecord, board: Readings, time_s: f64) {
        let is_stage = |role: &Role| Role::STAGES.contains(role);
        let dropped: u64 = status.processes().filter(|(r, _)| is_stage(r)).map(|(_, p)| p.skipped).sum();
        let last = status.processes().find(|(role, _)| *role == Role::LAST);
        let count = f64::from(self.frames);
        let mean = |sum: f64| (self.frames > 0).then(|| sum / count);
        let sample = Sample {
            number: self.next,
            time_s,
            rate_hz: last.map(|(_, p)| p.rate_hz),
            latency_ms: mean(self.latency_ms),
            latency_worst_ms: mean(self.latency_worst_ms * count),
            stage_ms: (self.frames > 0).then(|| self.stage_ms.map(|sum| sum / count)),
            // A daemon that was restarted counts from zero.
            dropped: self.dropped.map_or(0, |before| dropped.saturating_sub(before)),
            cpu_percent: status.processes().map(|(_, p)| p.cpu_percent).sum(),
            speed_m_s: status.motion.is_known().then_some(status.motion.speed_m_s),
            yaw_rate_rad_s: status.motion.is_known().then_some(status.motion.yaw_rate_rad_s),
            state: status.state_name(),
            calibration: status.calibration.state().name(),
            rung: (status.heat.watched == 1).then(|| status.heat.rung_name()),
            temperatures: board.temperatures,
            clocks: board.clocks,
        };
        let before = std::mem::take(self);
        *self = Self {
            samples: before.samples,
            next: before.next + 1,
            dropped: Some(dropped),
            ..Self::default()
        };
        if self.samples.len() == KEPT {
            self.samples.pop_front();
        }
        self.samples.push_back(sample);
    }

    /// The daemon has ended; the counters of the next one start from zero.
    pub fn daemon_gone(&mut self) {
        self.dropped = None;
    }

    /// The samples from number `from` on.
    pub fn since(&self, from: u64) -> Vec<Sample> {
        self.samples.iter().filter(|s| s.number >= from).cloned().collect()
    }

    /// The number of the next sample.
    pub fn next(&self) -> u64 {
        self.next
    }

    /// The last sample.
    pub fn last(&self) -> Option<&Sample> {
        self.samples.back()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::header::{Kind, Stamp};
    use messages::status::ProcessRecord;

    fn status(skipped: u64) -> StatusRecord {
        let mut status = StatusRecord::empty();
        (status.state, status.processes) = (1, 2);
        let process = status.process[0];
        let of = |role: Role| ProcessRecord { role: role as u32, cpu_percent: 20.0, skipped, ..process };
        (status.process[0], status.process[1]) = (of(Role::Stereo), of(Role::Recognition));
        status.process[1].rate_hz = 12.5;
        status
    }

    #[test]
    fn seconds_are_means_of_their_frames() {
        let mut history = History::default();
        for latency_ms in [20, 40] {
            let end_ns = 1_000_000 * (100 + latency_ms);
            let stamp = Stamp { begin_ns: end_ns - 5_000_000, end_ns };
            let mut header = Header::new(Kind::Obstacles);
            (header.capture_ns, header.stamps) = (100_000_000, [stamp; PATH_LENGTH]);
            history.frame(&header);
        }
        history.second(&status(100), Readings::default(), 7.0);
        history.second(&status(103), Readings::default(), 8.0);
        history.daemon_gone();
        history.second(&status(1), Readings::default(), 9.0);
        let samples = history.since(0);
        assert_eq!((samples[0].latency_ms, samples[0].latency_worst_ms), (Some(30.0), Some(40.0)));
        assert_eq!(samples[0].stage_ms, Some([5.0; PATH_LENGTH]));
        assert_eq!((samples[0].cpu_percent, samples[0].rate_hz), (40.0, Some(12.5)));
        assert_eq!((samples[1].latency_ms, samples[1].stage_ms), (None, None));
        assert_eq!([samples[0].dropped, samples[1].dropped, samples[2].dropped], [0, 6, 0]);
        assert_eq!(history.since(2).len(), 1);
        assert_eq!((samples[0].rung, samples[0].speed_m_s), (None, None));
        let mut hot = status(2);
        (hot.motion.health, hot.motion.speed_m_s, hot.motion.yaw_rate_rad_s) = (1, 7.5, -0.25);
        (hot.heat.watched, hot.heat.rung) = (1, 2);
        history.second(&hot, Readings::default(), 10.0);
        let last = history.last().unwrap();
        assert_eq!(
            (last.rung, last.speed_m_s, last.yaw_rate_rad_s),
            (Some("lower clocks"), Some(7.5), Some(-0.25))
        );
    }

    #[test]
    fn only_the_last_minutes_are_kept() {
        let mut history = History::default();
        for second in 0..KEPT + 20 {
            history.second(&status(0), Readings::default(), second as f64);
        }
        let samples = history.since(0);
        assert_eq!((samples.len(), samples[0].number), (KEPT, 20));
        assert_eq!(history.next(), (KEPT + 20) as u64);
    }
}
