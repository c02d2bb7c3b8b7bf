//! The vehicles of a fleet: who is connected, and what they say of themselves.

use super::keys::{Keys, vehicle_of};
use super::settings;
use crate::printable::Printable;
use config::Config;
use serde::Serialize;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::time::Duration;
use zenoh::query::{ConsolidationMode, QueryTarget};
use zenoh::{Session, Wait};

/// Longest wait for answers: a vehicle on a mobile network takes its time.
const TIMEOUT: Duration = Duration::from_secs(2);

/// Stands for any vehicle or fleet in a key.
const ANY: &str = "*";

/// A vehicle that is connected. What it did not answer is `null`.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Vehicle {
    /// Its fleet.
    pub fleet: String,
    /// Its name.
    pub vehicle: String,
    /// The daemon's state; `no daemon`, or `no answer` of the vehicle.
    pub state: String,
    /// Reason for that state.
    pub reason: String,
    /// Level of the alarm.
    pub alarm: Option<String>,
    /// Version of its bridge.
    pub version: Option<String>,
    /// Number of its events.
    pub events: Option<u64>,
    /// Events and pictures that gave way before they were sent.
    pub events_lost: Option<u64>,
}

impl Vehicle {
    fn new(fleet: &str, vehicle: &str, answer: Option<&Value>) -> Self {
        let text = |name: &str| Some(answer?.get(name)?.as_str()?.to_owned());
        let number = |name: &str| answer?.get(name)?.as_u64();
        Self {
            fleet: fleet.into(),
            vehicle: vehicle.into(),
            state: text("state").unwrap_or_else(|| "no answer".into()),
            reason: text("reason").unwrap_or_default(),
            alarm: text("alarm"),
            version: text("version"),
            events: number("events"),
            events_lost: number("events_lost"),
        }
    }
}

/// A connection to a fleet.
pub struct Fleet {
    session: Session,
    keys: Keys,
}

impl Fleet {
    /// Connects to the configured endpoints; to see one fleet, or all.
    ///
    /// # Errors
    /// If none answers.
    pub fn connect(config: &Config, fleet: Option<&str>) -> Result<Self, String> {
        let session = settings::session(config, false).map_err(|error| error.to_string())?;
        let session = zenoh::open(session).wait().map_err(|error| {
            format!(
                "bridge.connect = {}: {}: start a router there, or name another",
                config.bridge.connect,
                settings::reason(&error)
            )
        })?;
        Ok(Self { session, keys: Keys::new(fleet.unwrap_or(ANY), ANY) })
    }

    /// The vehicles that are connected now, in the order of their names.
    ///
    /// # Errors
    /// If the network takes no request.
    pub fn vehicles(&self) -> Result<Vec<Vehicle>, String> {
        let failed =
            |error: zenoh::Error| format!("the network takes no request: {}", settings::reason(&error));
        let tokens = self.session.liveliness().get(self.keys.alive()).timeout(TIMEOUT);
        let tokens = tokens.wait().map_err(failed)?;
        let request = format!("{}?brief", self.keys.topic("status"));
        let answers = self.session.get(request).target(QueryTarget::All);
        let answers = answers.consolidation(ConsolidationMode::None).timeout(TIMEOUT);
        let answers = answers.wait().map_err(failed)?;
        let mut vehicles: BTreeMap<(String, String), Option<Value>> = BTreeMap::new();
        while let Ok(reply) = tokens.recv() {
            if let Ok(sample) = reply.result()
                && let Some((fleet, vehicle)) = vehicle_of(sample.key_expr().as_str())
            {
                vehicles.insert((fleet.into(), vehicle.into()), None);
            }
        }
        while let Ok(reply) = answers.recv() {
            if let Ok(sample) = reply.result()
                && let Some((fleet, vehicle)) = vehicle_of(sample.key_expr().as_str())
                && let Ok(answer) = serde_json::from_slice(&sample.payload().to_bytes())
            {
                vehicles.insert((fleet.into(), vehicle.into()), Some(answer));
            }
        }
        let vehicle = |((fleet, name), answer): (&(String, String), &Option<Value>)| {
            Vehicle::new(fleet, name, answer.as_ref())
        };
        Ok(vehicles.iter().map(vehicle).collect())
    }
}

/// The vehicles as a table.
pub fn table(vehicles: &[Vehicle]) -> String {
    let mut text =
        format!("{:<16} {:<20} {:<10} {:<8} {:<9} reason", "fleet", "vehicle", "state", "alarm", "version");
    for vehicle in vehicles {
        let Vehicle { fleet, vehicle: name, state, reason, alarm, version, .. } = vehicle;
        let or_dash = |text: &Option<String>| text.clone().unwrap_or_else(|| "-".into());
        let (alarm, version) = (or_dash(alarm), or_dash(version));
        let line = format!("{fleet:<16} {name:<20} {state:<10} {alarm:<8} {version:<9} {reason}");
        // What a vehicle says comes from outside. Writing to a string never fails.
        let _ = write!(text, "\n{}", Printable(line.trim_end()));
    }
    let _ = write!(text, "\n{} connected", vehicles.len());
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn the_table_shows_what_vehicles_answer() {
        let answer =
            json!({ "state": "degraded", "reason": "hot\u{1b}[2J", "alarm": "clear", "version": "0.1.0" });
        let vehicles = [Vehicle::new("north", "car-7", Some(&answer)), Vehicle::new("north", "car-8", None)];
        let text = table(&vehicles);
        assert!(text.contains("car-7                degraded   clear    0.1.0     hot"), "{text}");
        assert!(text.contains("car-8                no answer  -        -"), "{text}");
        assert!(text.ends_with("2 connected") && !text.contains('\u{1b}'), "{text}");
    }
}
