//! What a stixel belongs to beside obstacles: a boundary, or ground at another height.

/// What a stixel belongs to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum StixelUse {
    /// Nothing yet: it may be part of an obstacle.
    #[default]
    Free,
    /// A boundary beside the path: a wall, a hedge, a guard rail. Where a boundary stands in the path its stixels stay
    /// [`Self::Free`], so that obstacles, and the alarm, see it.
    Boundary,
    /// Ground at another height than the road: a lawn or a pavement behind a kerb.
    RaisedGround,
}

impl StixelUse {
    /// Whether nothing else explains the stixel.
    pub fn is_free(self) -> bool {
        self == Self::Free
    }
}
