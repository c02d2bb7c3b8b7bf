//! The profiles that come with the daemon: what differs from the defaults.

/// Name and text of each profile. The first is used where none is named.
pub(crate) const PROFILES: [(&str, &str); 5] = [
    ("replay", include_str!("../profiles/replay.toml")),
    ("tk1", include_str!("../profiles/tk1.toml")),
    ("orin-nano", include_str!("../profiles/orin-nano.toml")),
    ("rpi5", include_str!("../profiles/rpi5.toml")),
    ("rk3588", include_str!("../profiles/rk3588.toml")),
];

/// Names of the built-in profiles.
pub fn profile_names() -> impl Iterator<Item = &'static str> {
    PROFILES.iter().map(|(name, _)| *name)
}
