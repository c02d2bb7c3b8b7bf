//! The linear SVM of a HOG detector, and its file.
//!
//! The file is text. A line that begins with `#` is a comment. Then, in this order: `lookout-hog 1`, `window WIDTH HEIGHT`
//! in pixels, `bias B`, `weights N`, and N weights, one a line, in the order of OpenCV's `HOGDescriptor`.

use super::block::{BLOCK, BLOCK_STRIDE};
use super::{BINS, CELL};
use crate::excerpt::{VALUE_CHARS, excerpt};
use thiserror::Error;

/// Bytes of a file: the people detector has 45 KB, the largest window 1.5 MB.
pub const MAX_BYTES: u64 = 4 << 20;

/// Width and height of a window, in pixels: two cells, and four times the height of OpenCV's people detector.
pub const WINDOW_PX: (usize, usize) = (2 * CELL, 512);

/// Largest weight, and bias: blocks have unit length, so such a weight would decide alone.
pub const MAX_WEIGHT: f32 = 1e6;

/// Why a file is no model.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum ModelError {
    /// The file is too large.
    #[error("{bytes} bytes: a model has at most {MAX_BYTES}: give a HOG model (models/README.md)")]
    TooLarge {
        /// Its length.
        bytes: usize,
    },
    /// A line is missing.
    #[error("the line \"{expected}\" is missing: the file ends too early")]
    Missing {
        /// What should stand there.
        expected: String,
    },
    /// A line is not what it should be.
    #[error("line {line}: \"{found}\" should be \"{expected}\"")]
    Line {
        /// Line of the file, from 1.
        line: usize,
        /// Excerpt of the line.
        found: String,
        /// What should stand there.
        expected: String,
    },
}

/// A linear SVM over the blocks of a window.
#[derive(Clone, Debug, PartialEq)]
pub struct HogModel {
    width: usize,
    height: usize,
    bias: f32,
    /// Row by row of blocks, [`BLOCK_STRIDE`] floats each.
    weights: Vec<f32>,
}

/// Blocks side by side in `pixels`.
fn blocks_in(pixels: usize) -> usize {
    (pixels / CELL).saturating_sub(1)
}

/// Number of weights of a window.
pub fn weight_count(width: usize, height: usize) -> usize {
    blocks_in(width) * blocks_in(height) * BLOCK
}

impl HogModel {
    /// A model of a window of `width` × `height` pixels with OpenCV's order of weights: column by column of blocks.
    /// `None` if the window is no number of cells or too large, if there are not as many weights as [`weight_count`] says,
    /// or if one is not finite or larger than [`MAX_WEIGHT`].
    pub fn new(width: usize, height: usize, bias: f32, weights: &[f32]) -> Option<Self> {
        let is_side = |px: usize| px.is_multiple_of(CELL) && (WINDOW_PX.0..=WINDOW_PX.1).contains(&px);
        // NaN is in no range.
        let is_weight = |w: &f32| (-MAX_WEIGHT..=MAX_WEIGHT).contains(w);
        if !is_side(width)
            || !is_side(height)
            || weights.len() != weight_count(width, height)
            || !weights.iter().chain([&bias]).all(is_weight)
        {
            return None;
        }
        let (across, down) = (blocks_in(width), blocks_in(height));
        let mut rows = vec![0.0; across * down * BLOCK_STRIDE];
        for (i, block) in weights.chunks_exact(BLOCK).enumerate() {
            let (column, row) = (i / down, i % down);
            rows[(row * across + column) * BLOCK_STRIDE..][..BLOCK].copy_from_slice(block);
        }
        Some(Self { width, height, bias, weights: rows })
    }

    /// Reads a model from the text of its file.
    ///
    /// # Errors
    /// If the text is too long, or a line is not what it should be; the error names the line.
    pub fn read(text: &str) -> Result<Self, ModelError> {
        if text.len() as u64 > MAX_BYTES {
            return Err(ModelError::TooLarge { bytes: text.len() });
        }
        let lines = text.lines().enumerate().map(|(i, line)| (i + 1, line.trim()));
        let mut lines = lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
        let mut next = |expected: &str| {
            lines.next().ok_or_else(|| ModelError::Missing { expected: expected.to_owned() })
        };
        let wrong = |line: usize, found: &str, expected: String| ModelError::Line {
            line,
            found: excerpt(found, VALUE_CHARS).into_owned(),
            expected,
        };
        let head = "lookout-hog 1";
        let (line, text) = next(head)?;
        if text != head {
            return Err(wrong(line, text, head.into()));
        }
        let expected = format!(
            "window WIDTH HEIGHT: multiples of {CELL} from {} to {} pixels",
            WINDOW_PX.0, WINDOW_PX.1
        );
        let (line, text) = next(&expected)?;
        let (width, height) = window(text).ok_or_else(|| wrong(line, text, expected))?;
        let number = format!("a number from {} to {MAX_WEIGHT}", -MAX_WEIGHT);
        let (line, text) = next("bias B")?;
        let bias = text.strip_prefix("bias ").and_then(weight);
        let bias = bias.ok_or_else(|| wrong(line, text, format!("bias B, {number}")))?;
        let count = weight_count(width, height);
        let expected = format!("weights {count}");
        let (line, text) = next(&expected)?;
        if text != expected {
            return Err(wrong(line, text, format!("{expected}: {} blocks of {BLOCK}", count / BLOCK)));
        }
        let mut weights = Vec::with_capacity(count);
        for i in 0..count {
            let (line, text) = next(&format!("weight {} of {count}", i + 1))?;
            weights.push(weight(text).ok_or_else(|| wrong(line, text, number.clone()))?);
        }
        if let Some((line, text)) = lines.next() {
            return Err(wrong(line, text, format!("the end, after {count} weights")));
        }
        // All that `new` refuses was refused above, by its line.
        Self::new(width, height, bias, &weights).ok_or(ModelError::Missing { expected: number })
    }

    /// Width and height of the window, in pixels.
    pub fn window(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// Width and height of the window, in blocks.
    pub fn blocks(&self) -> (usize, usize) {
        (blocks_in(self.width), blocks_in(self.height))
    }

    /// Added to the sum of products of a window.
    pub fn bias(&self) -> f32 {
        self.bias
    }

    /// The weights, row by row of blocks, each block followed by four zeros.
    pub fn rows(&self) -> &[f32] {
        &self.weights
    }
}

/// A window from its line.
fn window(text: &str) -> Option<(usize, usize)> {
    let (width, height) = text.strip_prefix("window ")?.split_once(' ')?;
    let side = |text: &str| {
        let px = text.parse::<usize>().ok()?;
        (px.is_multiple_of(CELL) && (WINDOW_PX.0..=WINDOW_PX.1).contains(&px)).then_some(px)
    };
    Some((side(width)?, side(height)?))
}

/// A weight from its text.
fn weight(text: &str) -> Option<f32> {
    text.parse::<f32>().ok().filter(|w| (-MAX_WEIGHT..=MAX_WEIGHT).contains(w))
}

const _: () = assert!(BLOCK == 4 * BINS && BLOCK < BLOCK_STRIDE);

#[cfg(test)]
mod tests {
    use super::*;

    fn text(weights: usize) -> String {
        format!(
            "# a comment\nlookout-hog 1\nwindow 16 24\nbias -0.5\nweights 72\n{}",
            "0.25\n".repeat(weights)
        )
    }

    #[test]
    fn a_model_is_read_and_what_is_wrong_is_named_with_its_line() {
        let model = HogModel::read(&text(72)).unwrap();
        assert_eq!((model.window(), model.blocks(), model.bias()), ((16, 24), (1, 2), -0.5));
        assert_eq!(model.rows().iter().filter(|&&w| w == 0.25).count(), 72);
        for (text, expected) in [
            (text(71), "\"weight 72 of 72\" is missing"),
            (text(73), "line 78: \"0.25\" should be \"the end, after 72 weights\""),
            (text(72).replacen("0.25", "NaN", 1), "line 6: \"NaN\" should be \"a number"),
            (text(72).replacen("0.25", "1e7", 1), "line 6"),
            (text(72).replace("16 24", "16 23"), "line 3: \"window 16 23\" should be"),
            (text(72).replace("16 24", "16 99999999999"), "line 3"),
            (text(72).replace("bias -0.5", "bias inf"), "line 4"),
            (text(72).replace("weights 72", "weights 108"), "should be \"weights 72: 2 blocks of 36\""),
            ("<opencv_storage>".to_owned(), "line 1: \"<opencv_storage>\" should be \"lookout-hog 1\""),
            (String::new(), "is missing"),
            (" ".repeat(MAX_BYTES as usize + 1), "a model has at most"),
        ] {
            let error = HogModel::read(&text).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
    }

    #[test]
    fn weights_are_taken_column_by_column() {
        let weights: Vec<f32> = (0..weight_count(24, 32)).map(|i| (i / BLOCK) as f32).collect();
        let model = HogModel::new(24, 32, 0.0, &weights).unwrap();
        let first: Vec<f32> = model.rows().chunks_exact(BLOCK_STRIDE).map(|b| b[0]).collect();
        assert_eq!(first, [0.0, 3.0, 1.0, 4.0, 2.0, 5.0]);
        assert!(HogModel::new(24, 32, f32::NAN, &weights).is_none());
        assert!(HogModel::new(24, 32, 0.0, &weights[1..]).is_none());
    }
}
