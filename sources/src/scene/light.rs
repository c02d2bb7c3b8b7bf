//! Lighting and atmosphere of a scene.

use super::mesh::{Point, unit};

/// Lighting parameters of a scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// Ambient light; together with [`Self::sun`], 1 is full daylight.
    pub ambient: f32,
    /// Sunlight on a face perpendicular to it.
    pub sun: f32,
    /// Unit vector towards the sun, in the road frame.
    pub towards_sun: Point,
    /// Grey value of the sky at the horizon.
    pub sky: f32,
    /// Increase of the sky's grey value per unit of slope above the horizon.
    pub sky_rise: f32,
    /// Contrast of the clouds.
    pub clouds: f32,
    /// Strength of the vehicle's headlamps on a face ahead of them.
    pub headlamps: f32,
    /// Distance at which the air leaves 1/e of the contrast, in metres.
    pub visibility_m: f32,
    /// Grey value of the airlight.
    pub air: f32,
    /// Whether street lamps and vehicle lamps are lit.
    pub lamps: bool,
    /// Specular reflection of a low sun ahead on the road, in grey levels.
    pub sheen: f32,
}

impl Light {
    /// A bright day with the sun behind the left shoulder.
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

    /// An overcast day without noticeable shadows.
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

    /// Headlamp light where the ray (`dx`, `dy`, 1) meets a face at `z` metres; `facing` is 1 where the face
    /// is perpendicular to the view.
    #[inline]
    pub fn lamps_at(&self, dx: f32, dy: f32, z: f32, facing: f32) -> f32 {
        let side = dx / 0.42;
        // The low beam is cut off slightly above the horizon.
        let above = ((-dy - 0.015) / 0.05).clamp(0.0, 1.0);
        let far = z / 20.0;
        self.headlamps * facing.max(0.0).sqrt() * (1.0 - 0.7 * above)
            / ((1.0 + side * side) * (1.0 + side * side) * (1.0 + far * far))
    }

    /// A grey value attenuated by `z` metres of air.
    #[inline]
    pub fn through_air(&self, grey: f32, z: f32) -> f32 {
        // The exponential as a power: accurate to 1 % where anything is visible.
        let share = (1.0 - z / (16.0 * self.visibility_m)).max(0.0);
        let fourth = (share * share) * (share * share);
        let clear = (fourth * fourth) * (fourth * fourth);
        self.air + (grey - self.air) * clear
    }
}
