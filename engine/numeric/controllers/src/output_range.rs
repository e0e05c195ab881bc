//! From the outputs of a network to actuators.

use serde::{Serialize, Serializer};

/// The interval of network outputs that becomes actuators from -1 to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OutputRange {
    low: f32,
    high: f32,
}

impl OutputRange {
    /// Outputs are actuators as they are.
    pub const SYMMETRIC: Self = Self {
        low: -1.0,
        high: 1.0,
    };
    /// Outputs from 0 to 1, as FREVO's networks give them.
    pub const UNIT: Self = Self {
        low: 0.0,
        high: 1.0,
    };

    /// None unless `low` < `high` and their distance is a finite binary32 above 0.
    pub fn new(low: f32, high: f32) -> Option<Self> {
        let width = high - low;
        (low.is_finite() && high.is_finite() && width.is_finite() && width > 0.0)
            .then_some(Self { low, high })
    }

    /// Lower and upper bound.
    pub fn bounds(self) -> (f32, f32) {
        (self.low, self.high)
    }

    /// The actuator for a network output: linear, then limited to -1..=1; a NaN (from an overflow) gives 0.
    ///
    /// -1..1 maps by o, 0..1 by 2*o - 1, any other by ((o - low) / (high - low)) * 2 - 1, all in binary32.
    #[inline]
    pub fn actuator(self, output: f32) -> f32 {
        let a = if self == Self::SYMMETRIC {
            output
        } else if self == Self::UNIT {
            2.0 * output - 1.0
        } else {
            ((output - self.low) / (self.high - self.low)) * 2.0 - 1.0
        };
        let a = if a.is_nan() { 0.0 } else { a };
        let a = if a > 1.0 { 1.0 } else { a };
        if a < -1.0 { -1.0 } else { a }
    }
}

impl Serialize for OutputRange {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        [self.low, self.high].serialize(serializer)
    }
}
