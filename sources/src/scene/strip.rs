//! Strips of ground beside the asphalt: kerbs, lawns, verges, ditches.

use super::material::{Look, Material};
use super::truth::{ROAD, VERGE};
use serde::Deserialize;

/// Side of the road.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Side {
    /// Left of the asphalt.
    Left,
    /// Right of the asphalt.
    Right,
}

impl Side {
    /// -1 for left, 1 for right: the sign of lateral positions there.
    pub fn sign(self) -> f64 {
        if self == Self::Left { -1.0 } else { 1.0 }
    }
}

/// What a strip is covered with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Cover {
    /// A lawn.
    Lawn,
    /// Rough grass.
    Grass,
    /// Paving slabs.
    Pavement,
    /// Gravel.
    Gravel,
    /// Bare earth or a field.
    Earth,
    /// Asphalt, with the road's lane markings: a cycle track, or another carriageway.
    Asphalt,
    /// Kerb stones.
    Stone,
}

impl Cover {
    /// Its material, and [`ROAD`] or [`VERGE`].
    pub fn surface(self) -> (Material, u16) {
        match self {
            Self::Lawn => (Material::new(Look::Grass, 88.0, 0.5, 0.015), VERGE),
            Self::Grass => (Material::new(Look::Grass, 80.0, 0.75, 0.025), VERGE),
            Self::Pavement => (Material::new(Look::Paving, 138.0, 0.6, 0.015), VERGE),
            Self::Gravel => (Material::new(Look::Grass, 124.0, 0.7, 0.012), VERGE),
            Self::Earth => (Material::new(Look::Grass, 98.0, 0.8, 0.03), VERGE),
            Self::Asphalt => (Material::new(Look::Road, 96.0, 1.0, 0.012), ROAD),
            Self::Stone => (Material::new(Look::Plain, 158.0, 0.5, 0.02), VERGE),
        }
    }
}

/// A strip of ground beside the asphalt.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StripFile {
    /// Side of the road.
    pub side: Side,
    /// Width, in metres.
    pub width_m: f64,
    /// Step at its near edge, in metres, up positive: a kerb.
    #[serde(default)]
    pub step_m: f64,
    /// Rise across it, away from the road, in metres; negative falls.
    #[serde(default)]
    pub rise_m: f64,
    /// What it is covered with.
    pub cover: Cover,
    /// Mean grey value, instead of the cover's.
    #[serde(default)]
    pub grey: Option<f64>,
}

impl StripFile {
    /// Its material, and [`ROAD`] or [`VERGE`].
    pub fn surface(&self) -> (Material, u16) {
        let (material, owner) = self.cover.surface();
        (Material { grey: self.grey.map_or(material.grey, |grey| grey as f32), ..material }, owner)
    }
}
