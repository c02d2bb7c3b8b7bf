//! What the configuration says about the bridge, checked.

use super::keys::Keys;
use crate::stages::whole_number::whole;
use config::{Bridge, Config};
use std::path::{Path, PathBuf};
use std::time::Duration;
use thiserror::Error;

/// Largest message that is received, in bytes: requests are short, and a fleet's answers are states.
const MAX_RECEIVED: usize = 1 << 20;

/// Where the host's name is.
const HOST: &str = "/proc/sys/kernel/hostname";

/// Why a configuration cannot be used.
#[derive(Debug, Error)]
pub enum SettingsError {
    /// The vehicle's name cannot be part of a key.
    #[error(
        "bridge.vehicle = {0:?}: give 1 to 64 letters, digits, - and _ (if it is empty, the host's name is taken)"
    )]
    Vehicle(String),
    /// No place for events.
    #[error("bridge.spool is empty, and neither STATE_DIRECTORY nor HOME is set: name a folder")]
    NoSpool,
    /// Certificate or key is missing.
    #[error("bridge.tls_certificate and bridge.tls_key: give both, or none")]
    HalfCertificate,
    /// zenoh does not take a value.
    #[error("bridge.{key} = {value}: {reason}")]
    Zenoh {
        /// The key.
        key: &'static str,
        /// Its value.
        value: String,
        /// What zenoh says.
        reason: String,
    },
}

/// Names of this vehicle.
///
/// # Errors
/// If the name cannot be part of a key.
pub fn vehicle(settings: &Bridge) -> Result<String, SettingsError> {
    let name = if settings.vehicle.is_empty() {
        // `car.example.com` is `car` in its fleet.
        let host = std::fs::read_to_string(HOST).unwrap_or_default();
        host.trim().split('.').next().unwrap_or_default().to_owned()
    } else {
        settings.vehicle.clone()
    };
    let is_part =
        !name.is_empty() && name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'-' || b == b'_');
    if is_part { Ok(name) } else { Err(SettingsError::Vehicle(name)) }
}

/// The keys of this vehicle.
///
/// # Errors
/// If the name cannot be part of a key.
pub fn keys(settings: &Bridge) -> Result<Keys, SettingsError> {
    Ok(Keys::new(&settings.fleet, &vehicle(settings)?))
}

/// The folder of this vehicle's events.
///
/// # Errors
/// If none is configured, and the environment names none.
pub fn spool(settings: &Bridge) -> Result<PathBuf, SettingsError> {
    let folder = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    let base = if settings.spool.as_os_str().is_empty() {
        let home = || folder("HOME").map(|home| home.join(".local/state/lookout"));
        folder("STATE_DIRECTORY").or_else(home).ok_or(SettingsError::NoSpool)?
    } else {
        settings.spool.clone()
    };
    Ok(base.join(&settings.fleet).join(vehicle(settings)?))
}

/// What zenoh says of an error, without the place in its sources.
pub fn reason(error: &zenoh::Error) -> String {
    let text = error.to_string();
    text.split(" at /").next().unwrap_or_default().trim_end_matches(['!', '.', ' ']).to_owned()
}

/// Time between two messages at a rate; `None` for none.
pub fn period(hertz: f64) -> Option<Duration> {
    (hertz > 0.0).then(|| Duration::from_secs_f64(1.0 / hertz))
}

/// Memory for what waits, in bytes.
pub fn buffer_bytes(settings: &Bridge) -> usize {
    whole::<usize>(settings.buffer_mb).saturating_mul(1_000_000)
}

/// Disk space for events, in bytes.
pub fn spool_bytes(settings: &Bridge) -> u64 {
    whole::<u64>(settings.spool_mb).saturating_mul(1_000_000)
}

/// The configuration of a zenoh session. Nothing is discovered: only the configured endpoints are used.
///
/// # Errors
/// If zenoh does not take a value.
pub fn session(config: &Config, listens: bool) -> Result<zenoh::Config, SettingsError> {
    let settings = &config.bridge;
    let mut session = zenoh::Config::default();
    let mut put = |key: &'static str, path: &str, json: serde_json::Value| {
        session.insert_json5(path, &json.to_string()).map_err(|error| SettingsError::Zenoh {
            key,
            value: json.to_string(),
            reason: reason(&error),
        })
    };
    let endpoints = |text: &str| {
        let parts = text.split(',').map(str::trim).filter(|part| !part.is_empty());
        serde_json::Value::from(parts.collect::<Vec<_>>())
    };
    let mode = if listens { &settings.mode[..] } else { "client" };
    put("mode", "mode", mode.into())?;
    put("connect", "connect/endpoints", endpoints(&settings.connect))?;
    put("listen", "listen/endpoints", endpoints(if mode == "peer" { &settings.listen } else { "" }))?;
    put("connect", "scouting/multicast/enabled", false.into())?;
    let nobody = serde_json::json!({ "router": [], "peer": [], "client": [] });
    put("connect", "scouting/gossip/autoconnect", nobody)?;
    put("connect", "transport/link/rx/max_message_size", MAX_RECEIVED.into())?;
    let has = |path: &Path| !path.as_os_str().is_empty();
    if has(&settings.tls_ca) {
        put("tls_ca", "transport/link/tls/root_ca_certificate", text(&settings.tls_ca))?;
    }
    match (has(&settings.tls_certificate), has(&settings.tls_key)) {
        (false, false) => {}
        (true, true) => {
            for side in ["connect", "listen"] {
                let (certificate, key) = (text(&settings.tls_certificate), text(&settings.tls_key));
                put("tls_certificate", &format!("transport/link/tls/{side}_certificate"), certificate)?;
                put("tls_key", &format!("transport/link/tls/{side}_private_key"), key)?;
            }
            put("tls_certificate", "transport/link/tls/enable_mtls", true.into())?;
        }
        _ => return Err(SettingsError::HalfCertificate),
    }
    Ok(session)
}

fn text(path: &Path) -> serde_json::Value {
    path.to_string_lossy().into_owned().into()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(keys: &str) -> Config {
        config::parse(&format!("[bridge]\n{keys}"), Path::new("car.toml")).unwrap()
    }

    #[test]
    fn the_vehicle_is_a_part_of_a_key() {
        assert_eq!(vehicle(&of("vehicle = \"car-7\"").bridge).unwrap(), "car-7");
        for wrong in ["a/b", "*", "a b", "ü"] {
            let error = vehicle(&of(&format!("vehicle = \"{wrong}\"")).bridge).unwrap_err();
            assert!(error.to_string().contains("bridge.vehicle"), "{error}");
        }
        assert_eq!(
            spool(&of("spool = \"/var/x\"\nvehicle = \"a\"").bridge).unwrap(),
            Path::new("/var/x/fleet/a")
        );
    }

    #[test]
    fn the_session_uses_the_configured_endpoints_alone() {
        let session = session(&of("connect = \"tcp/a:1, tls/b:2\"\nlisten = \"tcp/c:3\""), true).unwrap();
        assert_eq!(session.get_json("connect/endpoints").unwrap(), "[\"tcp/a:1\",\"tls/b:2\"]");
        assert_eq!(session.get_json("listen/endpoints").unwrap(), "[]", "a client does not listen");
        assert_eq!(session.get_json("scouting/multicast/enabled").unwrap(), "false");
        let error = super::session(&of("connect = \"nowhere\""), true).unwrap_err().to_string();
        assert!(error.starts_with("bridge.connect = [\"nowhere\"]"), "{error}");
        assert!(super::session(&of("tls_key = \"key.pem\""), true).is_err());
        assert_eq!(period(0.0), None);
        assert_eq!(period(4.0), Some(Duration::from_millis(250)));
    }
}
