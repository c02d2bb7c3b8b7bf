//! Surface materials: grey values in full daylight, filtered to the size of a pixel.

use super::texture::{Texture, floor};

/// Surface patterns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Look {
    /// Texture only.
    Plain,
    /// Asphalt with the lane markings of the road style.
    Road,
    /// Grass, with patches.
    Grass,
    /// Paving slabs with joints.
    Paving,
    /// Rows of windows.
    Facade,
    /// Brick courses.
    Brick,
    /// Car paint: brighter towards the top, with seams.
    Paint,
    /// Glass: dark, with smooth reflections.
    Glass,
    /// Foliage.
    Leaves,
}

/// A surface material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Its pattern.
    pub look: Look,
    /// Mean grey value in full daylight, 0 to 255.
    pub grey: f32,
    /// Texture contrast, 0 to about 1.
    pub contrast: f32,
    /// Texels per metre.
    pub per_m: f32,
    /// Offset into the texture, in metres.
    pub offset: f32,
    /// Emitted light, in grey levels.
    pub glow: f32,
}

impl Material {
    /// A material whose finest texture detail is `texel_m` metres.
    pub const fn new(look: Look, grey: f32, contrast: f32, texel_m: f32) -> Self {
        Self { look, grey, contrast, per_m: 1.0 / texel_m, offset: 0.0, glow: 0.0 }
    }

    /// The same material at another offset of the texture.
    pub fn shifted(self, offset: f32) -> Self {
        Self { offset, ..self }
    }

    /// The same material with emitted light.
    pub fn glowing(self, glow: f32) -> Self {
        Self { glow, ..self }
    }
}

/// A lane marking along the road.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    /// Metres right of the road's reference line.
    pub lateral_m: f32,
    /// Dashed: six metres of paint, six without.
    pub dashed: bool,
}

/// Lines across the road at intervals.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bays {
    /// Their left end, metres right of the road's reference line.
    pub from_m: f32,
    /// Their right end.
    pub to_m: f32,
    /// Position of one of them along the road, in metres.
    pub first_m: f32,
    /// Distance from one to the next, in metres.
    pub spacing_m: f32,
}

/// Surface parameters common to the whole road.
#[derive(Clone, Debug, Default)]
pub struct Style {
    /// Lane markings.
    pub lines: Vec<Line>,
    /// Lines across the road.
    pub bays: Vec<Bays>,
    /// Texture contrast of the asphalt; 0 is textureless.
    pub asphalt: f32,
    /// Share of the ground under snow, 0 to 1.
    pub snow: f32,
    /// Wetness of the ground, 0 to 1.
    pub wet: f32,
}

/// Intersection of a ray with a surface: texture coordinates and pixel footprint, in metres.
#[derive(Clone, Copy, Debug)]
pub struct Hit {
    /// Coordinate across.
    pub u: f32,
    /// Coordinate up, or along the road.
    pub v: f32,
    /// Pixel footprint in u.
    pub span_u: f32,
    /// Pixel footprint in v.
    pub span_v: f32,
}

/// Share of a pixel around `t` within the first `duty` of each period of 1; `span` is the pixel footprint.
#[inline]
pub fn pulse(t: f32, duty: f32, span: f32) -> f32 {
    let span = span.max(1e-4);
    let (from, to) = (t - span * 0.5, t + span * 0.5);
    let whole = floor(from) as f32;
    // Most pixels lie between two pulses, and need no division.
    if from - whole >= duty && to < whole + 1.0 {
        return 0.0;
    }
    let sum = |t: f32, whole: f32| whole * duty + (t - whole).min(duty);
    ((sum(to, floor(to) as f32) - sum(from, whole)) / span).clamp(0.0, 1.0)
}

/// Share of a pixel around `t` within `half` of zero.
#[inline]
fn band(t: f32, half: f32, span: f32) -> f32 {
    let span = span.max(1e-4);
    let within = half.min(t + span * 0.5) - (-half).max(t - span * 0.5);
    // Most pixels lie beside it, and need no division.
    if within > 0.0 { (within / span).min(1.0) } else { 0.0 }
}

impl Hit {
    #[inline]
    fn noise(&self, texture: &Texture, per_m: f32, offset: f32) -> f32 {
        texture.sample(
            (self.u + offset) * per_m,
            (self.v + 1.7 * offset) * per_m,
            self.span_u * per_m,
            self.span_v * per_m,
        )
    }

    /// [`Self::noise`], or zero where the pixel footprint is so long that little contrast remains.
    #[inline]
    fn fine_noise(&self, texture: &Texture, per_m: f32, offset: f32) -> f32 {
        if self.span_v * per_m > 48.0 { 0.0 } else { self.noise(texture, per_m, offset) }
    }
}

impl Material {
    /// Grey value in full daylight.
    #[inline]
    pub fn grey(&self, hit: Hit, texture: &Texture, style: &Style) -> f32 {
        match self.look {
            Look::Road => self.road(hit, texture, style),
            Look::Grass => {
                let n = hit.fine_noise(texture, self.per_m, self.offset);
                let coarse = hit.noise(texture, self.per_m * 0.11, 3.0);
                let v = self.grey + self.contrast * (0.7 * n + 0.5 * coarse);
                v + style.snow * (205.0 + 0.12 * coarse + 0.12 * n - v)
            }
            Look::Paving => {
                let n = hit.fine_noise(texture, self.per_m, self.offset);
                let joint = pulse(hit.u / 0.5, 0.04, hit.span_u / 0.5).max(pulse(
                    hit.v / 0.5,
                    0.04,
                    hit.span_v / 0.5,
                ));
                let v = self.grey + self.contrast * 0.6 * n - 38.0 * joint;
                v * (1.0 - 0.3 * style.wet) + style.snow * (200.0 + 0.1 * n - v)
            }
            Look::Facade => {
                let n = hit.noise(texture, self.per_m, self.offset);
                let (u, v) = ((hit.u + self.offset) / 2.6, (hit.v - 0.9) / 3.1);
                let (su, sv) = (hit.span_u / 2.6, hit.span_v / 3.1);
                let window = pulse(u, 0.46, su) * pulse(v, 0.5, sv);
                let sill = pulse(u + 0.04, 0.54, su) * pulse(v + 0.06, 0.06, sv);
                // Each window reflects something different.
                let own = ((floor(u) * 37 + floor(v) * 101) & 63) as f32 * 0.7 - 22.0 + 0.35 * n;
                let wall = self.grey + self.contrast * 0.55 * n + 35.0 * sill;
                wall + window * (58.0 + own - wall)
            }
            Look::Brick => {
                let n = hit.noise(texture, self.per_m, self.offset);
                let joint = pulse(hit.v / 0.08, 0.14, hit.span_v / 0.08);
                self.grey + self.contrast * 0.7 * n + 40.0 * (joint - 0.14)
            }
            Look::Paint => {
                let n = hit.noise(texture, self.per_m, self.offset);
                let seam = pulse((hit.u + 0.45) / 1.1, 0.016, hit.span_u / 1.1);
                let sheen = 0.72 + 0.42 * hit.v.clamp(0.0, 1.4);
                (self.grey * sheen + self.contrast * n) * (1.0 - 0.6 * seam)
            }
            Look::Glass => {
                let n = hit.noise(texture, self.per_m, self.offset);
                self.grey + self.contrast * n + 18.0 * hit.v.clamp(0.0, 3.0)
            }
            Look::Leaves => {
                let n = hit.noise(texture, self.per_m, self.offset);
                let coarse = hit.noise(texture, self.per_m * 0.19, 7.0);
                let v = self.grey + self.contrast * (0.8 * n + 0.5 * coarse);
                v + style.snow * 0.6 * (n * 0.02 + 0.5).clamp(0.0, 1.0) * (215.0 - v)
            }
            Look::Plain => self.grey + self.contrast * hit.noise(texture, self.per_m, self.offset),
        }
    }

    #[inline]
    fn road(&self, hit: Hit, texture: &Texture, style: &Style) -> f32 {
        let fine = hit.fine_noise(texture, self.per_m, self.offset);
        let coarse = hit.noise(texture, self.per_m * 0.13, 11.0);
        let mut v = self.grey + style.asphalt * (0.42 * fine + 0.42 * coarse);
        // A transverse joint every 17 m.
        v -= 30.0 * style.asphalt * pulse(hit.v / 17.0, 0.004, hit.span_v / 17.0);
        v *= 1.0 - 0.45 * style.wet;
        if style.snow > 0.0 {
            // Two partly clear wheel tracks in each lane of 3.5 m.
            let track = pulse((hit.u + 1.05) / 1.75, 0.2, hit.span_u / 1.75 + 0.1);
            let cover = style.snow * (1.0 - 0.75 * track * (0.6 + 0.01 * coarse)).clamp(0.0, 1.0);
            v += cover * (198.0 + 0.16 * fine + 0.2 * coarse - v);
            return v;
        }
        for line in &style.lines {
            let mut share = band(hit.u - line.lateral_m, 0.06, hit.span_u);
            if share > 0.0 {
                if line.dashed {
                    share *= pulse(hit.v / 12.0, 0.5, hit.span_v / 12.0);
                }
                v += share * (0.8 + 0.004 * fine) * (205.0 - v) * (1.0 - 0.35 * style.wet);
            }
        }
        for bays in &style.bays {
            let (middle, half) = (0.5 * (bays.from_m + bays.to_m), 0.5 * (bays.to_m - bays.from_m));
            let within = band(hit.u - middle, half, hit.span_u);
            if within > 0.0 {
                let at = (hit.v - bays.first_m + 0.06) / bays.spacing_m;
                let share = within * pulse(at, 0.12 / bays.spacing_m, hit.span_v / bays.spacing_m);
                v += share * (0.75 + 0.004 * fine) * (200.0 - v) * (1.0 - 0.35 * style.wet);
            }
        }
        v
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pulse_is_the_mean_over_the_pixel() {
        for (t, span) in [(0.1_f32, 0.05_f32), (0.29, 0.1), (3.95, 0.4), (-2.2, 2.7), (0.5, 40.0)] {
            let steps = 4000;
            let inside = (0..steps).filter(|&i| {
                let at = t + span * ((i as f32 + 0.5) / steps as f32 - 0.5);
                at - at.floor() < 0.3
            });
            let expected = inside.count() as f32 / steps as f32;
            assert!((pulse(t, 0.3, span) - expected).abs() < 2e-3, "{t} {span}");
        }
    }

    #[test]
    fn a_line_is_painted_where_it_lies() {
        let style =
            Style { lines: vec![Line { lateral_m: 1.75, dashed: false }], asphalt: 1.0, ..Style::default() };
        let road = Material::new(Look::Road, 95.0, 1.0, 0.012);
        let texture = Texture::new(1);
        let grey = |u: f32| {
            let hit = |v: f32| Hit { u, v, span_u: 0.01, span_v: 0.1 };
            (0..50).map(|i| road.grey(hit(i as f32), &texture, &style)).sum::<f32>() / 50.0
        };
        assert!(grey(1.75) > grey(1.5) + 60.0 && grey(1.75) > grey(2.0) + 60.0);
    }
}
