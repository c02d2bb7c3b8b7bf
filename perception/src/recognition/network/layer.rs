//! The operators of a network, on values whose channels lie side by side: row by row, pixel by pixel.
//!
//! All levels of instruction sets add the same products in the same order, so that results are the same bits everywhere.

use crate::simd::{Level, Simd, kernel};

/// Channels that a kernel computes at once; a value has a multiple of these, those beyond its own are 0. The input of a
/// network has one channel.
pub const CHANNELS: usize = 16;

/// Pixels that a kernel computes at once.
const PIXELS: usize = 4;

/// Height, width and channels of a value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Shape {
    /// Rows.
    pub height: usize,
    /// Columns.
    pub width: usize,
    /// Channels in the model.
    pub channels: usize,
    /// Channels in memory.
    pub stride: usize,
}

impl Shape {
    /// A value of a layer.
    pub fn new(height: usize, width: usize, channels: usize) -> Self {
        Self { height, width, channels, stride: channels.next_multiple_of(CHANNELS) }
    }

    /// Numbers in memory.
    pub fn numbers(&self) -> usize {
        self.height.saturating_mul(self.width).saturating_mul(self.stride)
    }
}

/// Where the windows of a layer lie in its input, in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Windows {
    /// Height and width of a window.
    pub size: (usize, usize),
    /// Steps from one to the next, down and across.
    pub step: (usize, usize),
    /// Zeros (of a maximum: nothing) around the input: top, left, bottom, right.
    pub padding: [usize; 4],
}

impl Windows {
    /// Windows that cover all of a value.
    pub fn whole(of: Shape) -> Self {
        Self { size: (of.height, of.width), step: (1, 1), padding: [0; 4] }
    }

    /// Rows and columns of windows; `None` if there are none.
    pub fn count(&self, of: Shape) -> Option<(usize, usize)> {
        let along = |side: usize, before: usize, after: usize, size: usize, step: usize| {
            Some((side + before + after).checked_sub(size)?.checked_div(step)? + 1)
        };
        let [top, left, bottom, right] = self.padding;
        Some((
            along(of.height, top, bottom, self.size.0, self.step.0)?,
            along(of.width, left, right, self.size.1, self.step.1)?,
        ))
    }

    /// Height and width of the input with its padding.
    pub fn padded(&self, of: Shape) -> (usize, usize) {
        let [top, left, bottom, right] = self.padding;
        (of.height + top + bottom, of.width + left + right)
    }
}

/// A convolution of all channels with all, or of each channel by itself (depthwise).
#[derive(Clone, Debug, PartialEq)]
pub struct Convolution {
    /// Its windows.
    pub windows: Windows,
    /// Whether each channel is convolved by itself.
    pub is_depthwise: bool,
    /// Channels of the output in the model.
    pub channels: usize,
    /// For each [`CHANNELS`] of the output: its weights for the first number of a window, for the second, and so on, rows of
    /// windows one after the other.
    pub weights: Vec<f32>,
    /// For each channel of the output.
    pub bias: Vec<f32>,
}

/// A value with its shape.
#[derive(Clone, Debug, PartialEq)]
pub struct Value {
    /// Its shape.
    pub shape: Shape,
    /// Its numbers.
    pub numbers: Vec<f32>,
}

impl Value {
    /// A value of zeros.
    pub fn new(shape: Shape) -> Self {
        Self { shape, numbers: vec![0.0; shape.numbers()] }
    }
}

/// Copies a value into the middle of zeros.
fn pad(value: &Value, windows: &Windows, out: &mut Vec<f32>) {
    let Shape { height, width, stride, .. } = value.shape;
    let (_, padded_width) = windows.padded(value.shape);
    let [top, left, ..] = windows.padding;
    out.clear();
    out.resize(padded_len(value.shape, windows), 0.0);
    for y in 0..height {
        let to = ((top + y) * padded_width + left) * stride;
        out[to..to + width * stride].copy_from_slice(&value.numbers[y * width * stride..][..width * stride]);
    }
}

/// Numbers of a value with the padding of a layer.
pub fn padded_len(shape: Shape, windows: &Windows) -> usize {
    let (height, width) = windows.padded(shape);
    Shape { height, width, ..shape }.numbers()
}

/// Computes a convolution; `padded` is memory.
pub fn convolve(level: Level, layer: &Convolution, from: &Value, padded: &mut Vec<f32>, to: &mut Value) {
    pad(from, &layer.windows, padded);
    let (_, columns) = layer.windows.padded(from.shape);
    let row = columns * from.shape.stride;
    let step = layer.windows.step;
    let width = to.shape.width;
    for y in 0..to.shape.height {
        let out = &mut to.numbers[y * width * to.shape.stride..][..width * to.shape.stride];
        let rows = &padded[y * step.0 * row..];
        let windows = &layer.windows;
        if layer.is_depthwise {
            depthwise_row(level, rows, row, windows, &layer.weights, &layer.bias, out);
        } else {
            convolved_row(level, rows, (row, from.shape.stride), windows, &layer.weights, &layer.bias, out);
        }
    }
}

kernel! {
    /// A row of a convolution: `rows` begins with the first row of its windows.
    fn convolved_row(
        rows: &[f32],
        strides: (usize, usize),
        windows: &Windows,
        weights: &[f32],
        bias: &[f32],
        out: &mut [f32],
    ) = convolved_row_of
}

kernel! {
    /// A row of a depthwise convolution.
    fn depthwise_row(
        rows: &[f32],
        row: usize,
        windows: &Windows,
        weights: &[f32],
        bias: &[f32],
        out: &mut [f32],
    ) = depthwise_row_of
}

#[inline(always)]
fn convolved_row_of<S: Simd>(
    _: S,
    rows: &[f32],
    strides: (usize, usize),
    windows: &Windows,
    weights: &[f32],
    bias: &[f32],
    out: &mut [f32],
) {
    let stride = bias.len();
    let pixels = out.len() / stride;
    let numbers = windows.size.0 * windows.size.1 * strides.1 * CHANNELS;
    for (block, bias) in bias.chunks_exact(CHANNELS).enumerate() {
        let weights = &weights[block * numbers..][..numbers];
        let bias: [f32; CHANNELS] = std::array::from_fn(|k| bias[k]);
        let mut x = 0;
        while x + PIXELS <= pixels {
            let sums =
                sums::<PIXELS>(&rows[x * windows.step.1 * strides.1..], strides, windows, weights, bias);
            for (p, sum) in sums.iter().enumerate() {
                out[(x + p) * stride + block * CHANNELS..][..CHANNELS].copy_from_slice(sum);
            }
            x += PIXELS;
        }
        while x < pixels {
            let [sum] = sums::<1>(&rows[x * windows.step.1 * strides.1..], strides, windows, weights, bias);
            out[x * stride + block * CHANNELS..][..CHANNELS].copy_from_slice(&sum);
            x += 1;
        }
    }
}

/// The sums of neighbouring windows, of which `rows` begins with the first.
#[inline(always)]
fn sums<const N: usize>(
    rows: &[f32],
    (row, channels): (usize, usize),
    windows: &Windows,
    weights: &[f32],
    bias: [f32; CHANNELS],
) -> [[f32; CHANNELS]; N] {
    let mut sums = [bias; N];
    // The columns of a window lie side by side.
    let count = windows.size.1 * channels;
    let step = windows.step.1 * channels;
    for (y, weights) in weights.chunks_exact(count * CHANNELS).enumerate() {
        let row = &rows[y * row..][..(N - 1) * step + count];
        for (i, weights) in weights.as_chunks::<CHANNELS>().0.iter().enumerate() {
            for (p, sums) in sums.iter_mut().enumerate() {
                let value = row[p * step + i];
                for (sum, weight) in sums.iter_mut().zip(weights) {
                    *sum += value * weight;
                }
            }
        }
    }
    sums
}

#[inline(always)]
fn depthwise_row_of<S: Simd>(
    _: S,
    rows: &[f32],
    row: usize,
    windows: &Windows,
    weights: &[f32],
    bias: &[f32],
    out: &mut [f32],
) {
    let stride = bias.len();
    for (x, out) in out.chunks_exact_mut(stride).enumerate() {
        out.copy_from_slice(bias);
        for (i, weights) in weights.chunks_exact(stride).enumerate() {
            let (dy, dx) = (i / windows.size.1, i % windows.size.1);
            let values = &rows[dy * row + (x * windows.step.1 + dx) * stride..][..stride];
            for ((sum, value), weight) in out.iter_mut().zip(values).zip(weights) {
                *sum += value * weight;
            }
        }
    }
}

/// How the numbers of a window become one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pooling {
    /// Their maximum.
    Maximum,
    /// Their mean; `true` counts the padding.
    Mean(bool),
}

/// Computes the maximum or mean of windows, channel by channel.
pub fn pool(pooling: Pooling, windows: &Windows, from: &Value, to: &mut Value) {
    let (stride, width) = (from.shape.stride, to.shape.width);
    let [top, left, ..] = windows.padding;
    for (i, out) in to.numbers.chunks_exact_mut(stride).enumerate() {
        // The part of the window that lies within the input.
        let inside = |at: usize, step: usize, before: usize, size: usize, side: usize| {
            let from = at * step;
            from.saturating_sub(before)..(from + size).saturating_sub(before).min(side)
        };
        let ys = inside(i / width, windows.step.0, top, windows.size.0, from.shape.height);
        let xs = inside(i % width, windows.step.1, left, windows.size.1, from.shape.width);
        let count = match pooling {
            Pooling::Mean(true) => windows.size.0 * windows.size.1,
            _ => ys.len() * xs.len(),
        };
        out.fill(if pooling == Pooling::Maximum { f32::MIN } else { 0.0 });
        for y in ys {
            for x in xs.clone() {
                let values = &from.numbers[(y * from.shape.width + x) * stride..][..stride];
                for (out, &value) in out.iter_mut().zip(values) {
                    match pooling {
                        Pooling::Maximum => *out = if value > *out { value } else { *out },
                        Pooling::Mean(_) => *out += value,
                    }
                }
            }
        }
        if pooling != Pooling::Maximum {
            let share = 1.0 / count.max(1) as f32;
            out.iter_mut().for_each(|v| *v *= share);
        }
    }
}

/// Limits numbers to a range.
pub fn clip(range: (f32, f32), numbers: &mut [f32]) {
    for v in numbers {
        // Not `clamp`, which keeps what is no number.
        *v = if *v > range.0 { *v } else { range.0 };
        *v = if *v < range.1 { *v } else { range.1 };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn random(random: &mut fastrand::Rng, count: usize) -> Vec<f32> {
        (0..count).map(|_| random.f32() - 0.5).collect()
    }

    /// The sum of a window in double precision, number by number.
    fn slow(layer: &Convolution, from: &Value, (y, x): (usize, usize), channel: usize) -> f64 {
        let w = layer.windows;
        let inputs = from.shape.stride;
        let mut sum = f64::from(layer.bias[channel]);
        for dy in 0..w.size.0 {
            for dx in 0..w.size.1 {
                let (py, px) = (y * w.step.0 + dy, x * w.step.1 + dx);
                let place = py.checked_sub(w.padding[0]).zip(px.checked_sub(w.padding[1]));
                let Some((py, px)) =
                    place.filter(|&(py, px)| py < from.shape.height && px < from.shape.width)
                else {
                    continue;
                };
                let values = &from.numbers[(py * from.shape.width + px) * inputs..][..inputs];
                let tap = dy * w.size.1 + dx;
                if layer.is_depthwise {
                    sum += f64::from(values[channel]) * f64::from(layer.weights[tap * inputs + channel]);
                    continue;
                }
                let (block, lane) = (channel / CHANNELS, channel % CHANNELS);
                let first = block * w.size.0 * w.size.1 * inputs + tap * inputs;
                for (i, &value) in values.iter().enumerate() {
                    sum += f64::from(value) * f64::from(layer.weights[(first + i) * CHANNELS + lane]);
                }
            }
        }
        sum
    }

    #[test]
    fn convolutions_are_those_of_the_slow_method_at_all_levels() {
        let mut rng = fastrand::Rng::with_seed(3);
        for (is_depthwise, stride, outputs, size, step, padding) in [
            (false, 1, 16, (3, 3), (1, 1), [1, 1, 1, 1]),
            (false, 16, 32, (3, 3), (2, 2), [1, 0, 0, 1]),
            (false, 32, 16, (7, 9), (1, 1), [0; 4]),
            (true, 32, 32, (3, 3), (1, 2), [1, 1, 1, 1]),
        ] {
            let shape = Shape { height: 7, width: 9, channels: stride, stride };
            let from = Value { shape, numbers: random(&mut rng, shape.numbers()) };
            let windows = Windows { size, step, padding };
            let inputs = if is_depthwise { 1 } else { stride };
            let layer = Convolution {
                windows,
                is_depthwise,
                channels: outputs,
                weights: random(&mut rng, size.0 * size.1 * inputs * outputs),
                bias: random(&mut rng, outputs),
            };
            let (height, width) = windows.count(shape).unwrap();
            let mut reference = Value::new(Shape::new(height, width, outputs));
            convolve(Level::PLAIN, &layer, &from, &mut Vec::new(), &mut reference);
            for (i, &found) in reference.numbers.iter().enumerate() {
                let (pixel, channel) = (i / outputs, i % outputs);
                let expected = slow(&layer, &from, (pixel / width, pixel % width), channel);
                assert!((f64::from(found) - expected).abs() < 1e-4, "{size:?} {i}: {found} {expected}");
            }
            for level in Level::available() {
                let mut other = Value::new(reference.shape);
                convolve(level, &layer, &from, &mut vec![7.0; 3], &mut other);
                let bits = |v: &Value| v.numbers.iter().map(|n| n.to_bits()).collect::<Vec<_>>();
                assert_eq!(bits(&other), bits(&reference), "{}", level.name());
            }
        }
    }

    #[test]
    fn pools_leave_out_what_lies_beyond_the_input() {
        let shape = Shape::new(3, 3, 1);
        let mut from = Value::new(shape);
        for (i, pixel) in from.numbers.chunks_exact_mut(CHANNELS).enumerate() {
            pixel[0] = -(i as f32) - 1.0;
        }
        let windows = Windows { size: (2, 2), step: (2, 2), padding: [0, 0, 1, 1] };
        assert_eq!(windows.count(shape), Some((2, 2)));
        let mut to = Value::new(Shape::new(2, 2, 1));
        let firsts = |to: &Value| to.numbers.iter().step_by(CHANNELS).copied().collect::<Vec<_>>();
        pool(Pooling::Maximum, &windows, &from, &mut to);
        assert_eq!(firsts(&to), [-1.0, -3.0, -7.0, -9.0]);
        pool(Pooling::Mean(false), &windows, &from, &mut to);
        assert_eq!(firsts(&to), [-3.0, -4.5, -7.5, -9.0]);
        pool(Pooling::Mean(true), &windows, &from, &mut to);
        assert_eq!(firsts(&to), [-3.0, -2.25, -3.75, -2.25]);
        clip((0.0, f32::MAX), &mut to.numbers);
        assert!(to.numbers.iter().all(|&v| v == 0.0));
        assert_eq!(Windows { size: (9, 9), ..windows }.count(shape), None);
        assert_eq!(Windows { step: (0, 1), ..windows }.count(shape), None);
    }
}
