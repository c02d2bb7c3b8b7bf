//! What lights the scene, and what the air does to it.

use super::mesh::{Point, unit};

/// Light of one scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// Light from everywhere; with [`Self::sun`], 1 is full daylight.
    pub ambient: f32,
    /// Light of the sun on a face that looks at it.
    pub sun: f32,
    /// Towards the sun, in the frame of the road, one long.
    pub towards_sun: Point,
    /// Grey value of the sky at the horizon.
    pub sky: f32,
    /// How much brighter the sky is above, per unit of slope.
    pub sky_rise: f32,
    /// Strength of the clouds.
    pub clouds: f32,
    /// The vehicle's own lamps, on a face before them.
    pub headlamps: f32,
    /// Distance at which the air leaves 1/e of the contrast, in metres.
    pub visibility_m: f32,
    /// Grey value of the air itself.
    pub air: f32,
    /// Whether lamps are lit.
    pub lamps: bool,
    /// Light of a low sun ahead that the road throws back, in grey levels.
    pub sheen: f32,
}

impl Light {
    /// A bright day, the sun behind the left shoulder.
    pub fn day() -> Self {
        Self {
            ambient: 0.62,
            sun: 0.62,
            towards_sun: unit([-0.45, 1.0, -0.6]),
            sky: 205.0,
            sky_rise: 30.0,
            clouds: 0.35,
            headlamps: 0.0,
            visibility_m: 2500.0,
            air: 195.0,
            lamps: false,
            sheen: 0.0,
        }
    }

    /// An overcast day: no shadows to speak of.
    pub fn overcast(brightness: f32) -> Self {
        Self {
            ambient: 0.85 * brightness,
            sun: 0.15 * brightness,
            sky: 195.0 * brightness,
            sky_rise: 15.0,
            clouds: 0.15,
            visibility_m: 600.0,
            air: 170.0 * brightness,
            ..Self::day()
        }
    }

    /// Light of the vehicle's lamps where the ray (`dx`, `dy`, 1) meets a face at `z` metres;
    /// `facing` is 1 where it looks at the camera.
    #[inline]
    pub fn lamps_at(&self, dx: f32, dy: f32, z: f32, facing: f32) -> f32 {
        let side = dx / 0.42;
        // The beam is cut off a little above the horizon.
        let above = ((-dy - 0.015) / 0.05).clamp(0.0, 1.0);
        let far = z / 20.0;
        self.headlamps * facing.max(0.0).sqrt() * (1.0 - 0.7 * above)
            / ((1.0 + side * side) * (1.0 + side * side) * (1.0 + far * far))
    }

    /// What is left of a grey value seen through `z` metres of air.
    #[inline]
    pub fn through_air(&self, grey: f32, z: f32) -> f32 {
        let clear = (-z / self.visibility_m).exp();
        self.air + (grey - self.air) * clear
    }
}
