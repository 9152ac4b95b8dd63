//! The ground the rig stands on: where it is in the disparity map, and how the camera stands over it.

mod plane;

pub use plane::GroundPlane;

/// Why no ground is known.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NoGround {
    /// Too few pixels have a disparity.
    TooFewPixels,
    /// Nothing plausible holds enough of them: a wall fills the view, or the camera does not look at the floor.
    NoPlane,
    /// What looks like ground has too much below it: a table top, a shelf.
    SomethingBelow,
    /// Not asked for.
    NotAsked,
}

impl NoGround {
    /// In words.
    pub fn reason(self) -> &'static str {
        match self {
            Self::TooFewPixels => "too few pixels have a disparity",
            Self::NoPlane => "no plane at a plausible height and angle holds enough pixels",
            Self::SomethingBelow => "the best plane has too much below it to be the ground",
            Self::NotAsked => "not asked for",
        }
    }
}

/// The ground, or why there is none.
pub type Ground = Result<GroundPlane, NoGround>;
