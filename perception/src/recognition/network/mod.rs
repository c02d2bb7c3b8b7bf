//! Small neural networks as recognisers of several classes, read from ONNX files.
//!
//! Input is the rectangle of a region in a grey image, resized to the input of the network with its mean taken off and divided
//! by its contrast; output are the log-odds of each class. The subset of operators is that of small convolutional
//! classifiers; they are computed here, not by a library, so that no memory is allocated while frames are processed and the
//! results are the same bits on every machine.
//!
//! | module | contents |
//! |---|---|
//! | [`error`] | why a file is no network |
//! | [`graph`] | the plan of a network, from an ONNX file |
//! | [`layer`] | the operators |
//! | [`limits`] | limits of files and networks |
//! | [`onnx`] | the file format |
//! | [`properties`] | names and sizes of the classes |
//! | [`sample`] | a rectangle of an image as input |
//! | `recogniser` | log-odds of the classes of a region |

pub mod error;
pub mod graph;
pub mod layer;
pub mod limits;
pub mod onnx;
pub mod properties;
mod recogniser;
pub mod sample;

pub use error::NetworkError;
pub use graph::Network;
pub use recogniser::{MIN_CONTRAST, NetworkRecogniser};
