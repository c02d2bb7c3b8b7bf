//! Why a file is no network.

use super::limits::{MAX_BYTES, MAX_PRODUCTS, OPSETS};
use std::borrow::Cow;
use thiserror::Error;

/// Why a file is no network.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum NetworkError {
    /// The file is too large.
    #[error("{bytes} bytes: a network has at most {MAX_BYTES}")]
    TooLarge {
        /// Its length.
        bytes: usize,
    },
    /// The bytes are no ONNX file.
    #[error("no ONNX file: {0}")]
    Format(String),
    /// The operators are of an unknown version.
    #[error("operators of version {version}: export with opset {} to {}", OPSETS.start(), OPSETS.end())]
    Opset {
        /// The version.
        version: i64,
    },
    /// The input or output is not as it should be.
    #[error("{0}")]
    Shape(&'static str),
    /// An operator cannot be computed.
    #[error("operator {operator} of \"{value}\": {why}")]
    Operator {
        /// Its name.
        operator: String,
        /// The value that it computes.
        value: String,
        /// The cause.
        why: &'static str,
    },
    /// A property is missing or wrong.
    #[error("property \"{name}\": \"{value}\" should be {expected}")]
    Property {
        /// Its name.
        name: &'static str,
        /// Excerpt of its value.
        value: String,
        /// What it should be.
        expected: Cow<'static, str>,
    },
    /// A look would take too long.
    #[error("{0} products for a look: at most {MAX_PRODUCTS}; give a smaller network")]
    Cost(u64),
}
