//! The road of a frame, as far as free space depends on it.

use crate::road::edges::Edges;
use crate::road::surface::RoadSurface;

/// The road of a frame.
#[derive(Clone, Copy, Debug)]
pub struct RoadView<'a> {
    /// Its surface.
    pub surface: &'a RoadSurface,
    /// Its disparity in each row, in px.
    pub profile_px: &'a [f32],
    /// First row of the image, from the top, that belongs to it.
    pub top: usize,
    /// Its edges.
    pub edges: &'a Edges,
}
