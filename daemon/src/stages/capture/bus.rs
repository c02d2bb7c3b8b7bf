//! The vehicle's bus, read by a thread without real-time priority. The stage takes the newest values with each pair: it
//! neither allocates nor waits for that.

use crate::input::vehicle::{decoder, stale_ns};
use crate::launch::Launch;
use crate::stages::vehicle_record::record;
use messages::motion::VehicleRecord;
use sources::vehicle::{BusState, VehicleError};
use std::sync::{Arc, Mutex};

/// The newest values of the bus.
#[derive(Debug)]
pub struct Bus {
    shared: Arc<Mutex<BusState>>,
    /// What the stage took last: it holds while the thread is writing.
    last: BusState,
    stale_ns: u64,
}

impl Bus {
    /// Starts the thread that reads `vehicle.bus`; `None` if that is empty.
    ///
    /// # Errors
    /// If the signals of the bus cannot be found.
    pub fn start(launch: &Launch) -> Result<Option<Self>, VehicleError> {
        let Some(decoder) = decoder(&launch.config)? else { return Ok(None) };
        let state = decoder.state();
        let bus =
            Self { shared: Arc::new(Mutex::new(state)), last: state, stale_ns: stale_ns(&launch.config) };
        #[cfg(feature = "can")]
        {
            let thread = thread::Reader {
                interface: launch.config.vehicle.bus.clone(),
                decoder,
                shared: Arc::clone(&bus.shared),
                stale_ns: bus.stale_ns,
            };
            // It is never joined: it ends with the stage. Without it the values are missing, which the header says.
            let spawned = std::thread::Builder::new().name("bus".into()).spawn(move || thread.run());
            if let Err(error) = spawned {
                tracing::error!("the thread of the vehicle's bus cannot be started: {error}");
            }
        }
        Ok(Some(bus))
    }

    /// What the vehicle reports for a pair that was exposed at `capture_ns`.
    pub fn at(&mut self, capture_ns: u64) -> VehicleRecord {
        // The thread may have been interrupted with the lock in its hand: then the values from before it hold.
        if let Ok(state) = self.shared.try_lock() {
            self.last = *state;
        }
        record(&self.last.reading(capture_ns, self.stale_ns))
    }
}

#[cfg(feature = "can")]
mod thread {
    use messages::clock::monotonic_ns;
    use sources::vehicle::can::CanBus;
    use sources::vehicle::{BusState, Decoder, Frame, VehicleFaults, Watch};
    use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
    use std::time::Duration;

    /// Maximum time of one wait for a frame; stale values are noticed in between.
    const PATIENCE: Duration = Duration::from_millis(100);

    /// Time before a bus that is down is opened again: a board brings its interfaces up within seconds.
    const RETRY: Duration = Duration::from_secs(1);

    /// Time after which a bus that was read counts as sound: its next failure is told as the first.
    const STEADY_NS: u64 = 60_000_000_000;

    /// Reads the bus.
    pub struct Reader {
        pub interface: String,
        pub decoder: Decoder,
        pub shared: Arc<Mutex<BusState>>,
        pub stale_ns: u64,
    }

    impl Reader {
        /// Reads until the process ends. A bus that is down is tried again.
        pub fn run(&self) {
            let mut watch = Watch::default();
            let mut failures = 0_u64;
            loop {
                let opened_ns = monotonic_ns();
                let opened = CanBus::open(&self.interface, &self.decoder, PATIENCE);
                let error = opened.map_or_else(|error| error, |bus| self.follow(&bus, &mut watch));
                self.lock().closed();
                if monotonic_ns().saturating_sub(opened_ns) > STEADY_NS {
                    failures = 0;
                }
                failures += 1;
                if failures.is_power_of_two() {
                    tracing::warn!(
                        bus = %self.interface,
                        failures,
                        "the vehicle's bus cannot be read: {error}: check vehicle.bus and that the interface is up; \
                         it is tried again"
                    );
                }
                std::thread::sleep(RETRY);
            }
        }

        /// Reads frames until the bus fails.
        fn follow(&self, bus: &CanBus, watch: &mut Watch) -> std::io::Error {
            let started_ns = monotonic_ns();
            let mut is_open = false;
            loop {
                let received = match bus.receive() {
                    Ok(received) => received,
                    Err(error) => return error,
                };
                if !is_open {
                    // An interface that is down can be opened; the first read fails.
                    is_open = true;
                    self.lock().opened();
                    tracing::info!(bus = %self.interface, "the vehicle's bus is open");
                }
                if let Some(text) = self.take(received, started_ns, watch) {
                    tracing::warn!(bus = %self.interface, "{text}");
                }
            }
        }

        /// Takes a frame, if one came. Returns what is to be told.
        fn take(
            &self,
            received: Option<(Frame, Duration)>,
            started_ns: u64,
            watch: &mut Watch,
        ) -> Option<String> {
            let now_ns = monotonic_ns();
            let mut state = self.lock();
            let refused = received.and_then(|(frame, age)| {
                let time_ns = now_ns.saturating_sub(age.as_nanos() as u64);
                self.decoder.decode(&frame, time_ns, &mut state)
            });
            let faults = state.reading(now_ns, self.stale_ns).faults;
            drop(state);
            let text = refused.and_then(|refused| watch.refused(refused));
            // Signals need a moment to come for the first time; those out of range were told with their values.
            let is_early = now_ns.saturating_sub(started_ns) <= self.stale_ns;
            let faults = VehicleFaults { out_of_range: false, ..faults };
            text.or_else(|| if is_early { None } else { watch.faults(faults) })
        }

        fn lock(&self) -> MutexGuard<'_, BusState> {
            self.shared.lock().unwrap_or_else(PoisonError::into_inner)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sources::vehicle::{BusSettings, Decoder, Frame};

    #[test]
    fn the_stage_never_waits_for_the_thread() {
        let settings = BusSettings { speed_signal: "1:0|8@1+ (1,0) m/s".into(), ..BusSettings::default() };
        let decoder = Decoder::new(&settings).unwrap();
        let mut state = decoder.state();
        state.opened();
        let shared = Arc::new(Mutex::new(state));
        let mut bus = Bus { shared: Arc::clone(&shared), last: state, stale_ns: 1000 };
        decoder.decode(&Frame::new(1, false, &[20]), 100, &mut shared.lock().unwrap());
        assert_eq!(bus.at(200).speed_m_s, 20.0);
        let mut held = shared.lock().unwrap();
        decoder.decode(&Frame::new(1, false, &[30]), 300, &mut held);
        assert_eq!(bus.at(400).speed_m_s, 20.0, "the thread holds the lock");
        drop(held);
        assert_eq!(bus.at(400).speed_m_s, 30.0);
        assert_eq!(
            bus.at(9000).faults,
            messages::motion::vehicle_faults::STALE | messages::motion::vehicle_faults::NO_BUS
        );
    }
}
