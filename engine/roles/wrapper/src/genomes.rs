//! Genomes of a request, either sent or generated from a sample.

use std::ops::Range;

use swarmwright_evolution::{GaussianSample, Scale};
use swarmwright_protocol::{NORMAL, Sample};

/// The genomes of a request.
#[derive(Debug)]
pub(crate) enum Genomes {
    /// (candidates, weights), row-major.
    Sent(Vec<f32>),
    /// Generated when needed.
    Sample(Box<Sample>),
}

impl Genomes {
    /// Reads the genomes of a valid message for a controller with `weights` weights.
    ///
    /// # Errors
    /// Returns why the genomes do not match the controller, or why this server cannot generate them.
    pub fn new(
        sent: Vec<f32>,
        sample: Option<Box<Sample>>,
        weights: usize,
    ) -> Result<Self, String> {
        let numbers = sent.len();
        match sample {
            None if numbers.is_multiple_of(weights) => Ok(Self::Sent(sent)),
            None => Err(format!(
                "genomes: {numbers} numbers are not a whole number of candidates; the controller has {weights} weights"
            )),
            Some(sample) if sample.distribution != NORMAL => Err(format!(
                "sample.distribution: {:?} is unknown here, only {NORMAL}",
                sample.distribution
            )),
            Some(sample) if sample.center.0.len() != weights => Err(format!(
                "sample.center: {} numbers, but the controller has {weights} weights",
                sample.center.0.len()
            )),
            Some(sample) => Ok(Self::Sample(sample)),
        }
    }

    /// Returns the number of candidates.
    pub fn candidates(&self, weights: usize) -> usize {
        match self {
            Self::Sent(numbers) => numbers.len() / weights,
            Self::Sample(sample) => usize::try_from(sample.count).unwrap_or(usize::MAX),
        }
    }

    /// Returns the number of bytes held.
    pub fn bytes(&self) -> usize {
        match self {
            Self::Sent(numbers) => size_of_val(&numbers[..]),
            Self::Sample(sample) => sample.rows().iter().map(|(_, row)| size_of_val(*row)).sum(),
        }
    }

    /// Returns the genomes of some candidates. Generated ones are written to `buffer`, in the current thread if
    /// `threads` is 1.
    pub fn of<'a>(
        &'a self,
        candidates: Range<usize>,
        weights: usize,
        threads: usize,
        buffer: &'a mut Vec<f32>,
    ) -> &'a [f32] {
        let sample = match self {
            Self::Sent(numbers) => {
                return &numbers[candidates.start * weights..candidates.end * weights];
            }
            Self::Sample(sample) => sample,
        };
        let gaussian = gaussian(sample);
        buffer.resize(candidates.len() * weights, 0.0);
        let first = sample.first + candidates.start as u64;
        if threads == 1 {
            gaussian.genomes(first, buffer);
        } else {
            gaussian.genomes_parallel(first, buffer);
        }
        buffer
    }
}

/// Returns the distribution of a valid sample.
#[must_use]
pub fn gaussian(sample: &Sample) -> GaussianSample<'_> {
    GaussianSample {
        seed: sample.seed,
        purpose: &sample.purpose,
        generation: sample.generation,
        mirrored: sample.mirrored,
        center: &sample.center.0,
        deviation: &sample.deviation.0,
        scale: Scale {
            middle: &sample.middle.0,
            reach: &sample.reach.0,
            lower: &sample.lower.0,
            upper: &sample.upper.0,
        },
    }
}
