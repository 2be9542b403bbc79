//! First values of parameters in a search for a missing effect: those that no derivative at "absent" can find.

use crate::num::Vec2;

/// The first values of one parameter in a search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Seed {
    /// These values.
    Values(&'static [f64]),
    /// Coordinates over the region of the data (m).
    PlaceX,
    PlaceY,
    /// Distances of lines through the region from the origin (m).
    Offset,
    /// Shares of the region's size (m).
    Reach,
    /// Directions all around (rad).
    Angle,
    /// Frequencies that the video can resolve (Hz).
    Frequency,
}

/// Seeds by name of parameter; a parameter without one starts at its default.
pub type Seeds = &'static [(&'static str, Seed)];

/// What a search has to know of the data.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Region {
    /// Corners of the box that all tracks lie in (m).
    pub low: Vec2,
    pub high: Vec2,
    /// Of the longest video (s).
    pub duration: f64,
    /// Seeds along each coordinate of a place.
    pub places: usize,
}

/// Highest frequency of a search (Hz): above it a shaken table moves things less than a camera resolves.
const HIGHEST_FREQUENCY: f64 = 5.0;
/// Directions around the circle.
const ANGLES: usize = 8;
/// Shares of the region's larger side.
const REACHES: [f64; 3] = [0.08, 0.16, 0.32];

impl Seed {
    /// The values to try.
    pub fn values(&self, region: &Region) -> Vec<f64> {
        let along = |low: f64, high: f64| {
            let n = region.places.max(1);
            (0..n).map(|k| low + (high - low) * (k as f64 + 0.5) / n as f64).collect()
        };
        match self {
            Seed::Values(values) => values.to_vec(),
            Seed::PlaceX => along(region.low.x, region.high.x),
            Seed::PlaceY => along(region.low.y, region.high.y),
            Seed::Offset => {
                let far = |v: Vec2| v.x.abs().max(v.y.abs());
                let far = far(region.low).max(far(region.high));
                along(-far, far)
            }
            Seed::Reach => {
                let size = (region.high.x - region.low.x).max(region.high.y - region.low.y);
                REACHES.iter().map(|share| share * size).collect()
            }
            Seed::Angle => (0..ANGLES).map(|k| std::f64::consts::TAU * k as f64 / ANGLES as f64).collect(),
            Seed::Frequency => {
                // Half the video's resolution, so that none falls between two seeds.
                let step = 0.5 / region.duration.max(0.1);
                (1..).map(|k| k as f64 * step).take_while(|f| *f <= HIGHEST_FREQUENCY).collect()
            }
        }
    }
}
