//! Genes within bounds: a smooth, periodic transformation, as the library cma has it (BoundTransform).
//!
//! It leaves values alone but near a bound, where it is quadratic: the bound itself is the vertex of a parabola, so that an optimum
//! there is one of the distribution's mean too. Values beyond come back, mirrored.

/// Largest number of binary32.
const LARGEST: f64 = f32::MAX as f64;

#[derive(Debug, Clone)]
pub(super) struct Bounds {
    lower: Vec<f64>,
    upper: Vec<f64>,
    any: bool,
}

impl Bounds {
    pub fn new(lower: &[f64], upper: &[f64]) -> Self {
        let finite = |limits: &[f64]| limits.iter().any(|limit| limit.is_finite());
        Self {
            any: finite(lower) || finite(upper),
            lower: lower.to_vec(),
            upper: upper.to_vec(),
        }
    }

    /// The distance of the bounds of a gene; infinite where one is missing.
    pub fn width(&self, gene: usize) -> f64 {
        self.upper[gene] - self.lower[gene]
    }

    /// Whether a gene has one.
    pub fn any(&self) -> bool {
        self.any
    }

    /// The gene that a value stands for: within the bounds, and finite.
    pub fn within(&self, gene: usize, value: f64) -> f64 {
        let (lower, upper) = (self.lower[gene], self.upper[gene]);
        if lower == f64::NEG_INFINITY && upper == f64::INFINITY {
            return finite(value);
        }
        let folded = finite(fold(value, lower, upper));
        // Against roundings.
        folded.max(lower).min(upper)
    }

    /// Replaces genes by values that stand for them.
    pub fn undo(&self, genes: &mut [f64]) {
        for (gene, value) in genes.iter_mut().enumerate() {
            let (lower, upper) = (self.lower[gene], self.upper[gene]);
            let [low, high] = margins(lower, upper);
            let inside = value.clamp(lower, upper);
            *value = if inside < lower + low {
                lower - low + 2.0 * (low * (inside - lower)).sqrt()
            } else if inside > upper - high {
                upper + high - 2.0 * (high * (upper - inside)).sqrt()
            } else {
                inside
            };
        }
    }
}

/// How far from each bound the transformation is quadratic.
fn margins(lower: f64, upper: f64) -> [f64; 2] {
    [lower, upper].map(|bound| {
        if bound.is_finite() {
            (bound.abs().max(1.0) / 20.0).min((upper - lower) / 2.0)
        } else {
            1.0
        }
    })
}

fn fold(value: f64, lower: f64, upper: f64) -> f64 {
    let [low, high] = margins(lower, upper);
    let half = (upper - lower) / 2.0;
    let mut value = value;
    if value < lower - 2.0 * low - half || value > upper + 2.0 * high + half {
        let period = 2.0 * (upper - lower + low + high);
        let start = lower - 2.0 * low - half;
        value -= period * ((value - start) / period).floor();
    }
    if value > upper + high {
        value -= 2.0 * (value - upper - high);
    }
    if value < lower - low {
        value += 2.0 * (lower - low - value);
    }
    if value < lower + low {
        let depth = value - (lower - low);
        lower + depth * depth / 4.0 / low
    } else if value > upper - high {
        let depth = value - (upper + high);
        upper - depth * depth / 4.0 / high
    } else {
        value
    }
}

/// A value as near as a binary32 can be; the least one for NaN.
#[inline]
pub(super) fn finite(value: f64) -> f64 {
    let value = if value >= -LARGEST { value } else { -LARGEST };
    if value <= LARGEST { value } else { LARGEST }
}
