//! Work for the pool.

use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;

use serde_json::{Map, Value};
use swarmwright_controllers::{Architecture, Controller, ControllerError, SpecificationError};
use swarmwright_protocol::Sample;

/// Controllers of one architecture that are all run in the same episodes.
#[derive(Debug, Clone)]
pub struct Work {
    architecture: Arc<Architecture>,
    specification: Map<String, Value>,
    /// Genomes of candidate `forgotten` and later ones.
    genomes: Vec<f32>,
    forgotten: usize,
    seeds: Vec<u64>,
    /// The sample that all genomes are from, if servers can expand it.
    sample: Option<Box<Sample>>,
    /// Generates the genomes, if there is only the sample.
    make: Option<MakeGenomes>,
    /// Evaluations to do; `None` for every candidate in every episode.
    only: Option<Vec<Repetition>>,
    /// Whether candidates whose results are invalidated are returned again.
    revised: bool,
}

/// An evaluation to repeat.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Repetition {
    /// Index of the candidate.
    pub candidate: usize,
    /// Index of the episode.
    pub episode: usize,
    /// Server that evaluated it before; another one is preferred.
    pub before: Option<u64>,
}

/// Generates the genomes of a valid sample, (candidates, weights) row-major.
pub type MakeGenomes = fn(&Sample) -> Vec<f32>;

/// Errors in the definition of work.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum WorkError {
    /// The specification of the controllers is invalid.
    #[error(transparent)]
    Specification(#[from] SpecificationError),
    /// The number of values is not a multiple of the number of weights.
    #[error(
        "genomes: {numbers} numbers are not a multiple of {weights}, the weights of a controller"
    )]
    Shape {
        /// Number of values given.
        numbers: usize,
        /// Number of weights of a controller.
        weights: usize,
    },
    /// A weight that is NaN or infinite.
    #[error("genomes[{candidate}][{weight}] is NaN or infinite")]
    NotFinite {
        /// Index of the genome.
        candidate: usize,
        /// Index of the weight.
        weight: usize,
    },
    /// The sample is invalid, or does not match the genomes in number or size.
    #[error("sample: {0}")]
    Sample(String),
    /// Servers announce only one of the numbers of sensors and actuators; the name of the other one.
    #[error("the servers do not announce their number of {0}; add `{0}:` to the experiment")]
    Unannounced(&'static str),
    /// There are no episodes.
    #[error("seeds: expected at least one")]
    NoEpisode,
    /// A requested evaluation is not part of the work.
    #[error("only[{index}]: candidate {candidate} or episode {episode} does not exist")]
    NoSuchEvaluation {
        /// Index of the requested evaluation.
        index: usize,
        /// Candidate of the evaluation.
        candidate: usize,
        /// Episode of the evaluation.
        episode: usize,
    },
}

/// Smallest number of candidates whose genomes take more bytes than their distribution: six rows of binary64.
const MIN_SAMPLE: usize = 16;
/// Number of values that are checked together, since the compiler vectorizes only loops without an early exit.
const TOGETHER: usize = 1024;

/// Checks that genomes and seeds match an architecture.
///
/// # Errors
/// See [`Work::new`].
pub fn check_work(
    architecture: &Architecture,
    genomes: &[f32],
    seeds: &[u64],
) -> Result<(), WorkError> {
    check_shape(architecture, genomes, seeds)?;
    check_finite(architecture, genomes)
}

/// Like [`check_work`], without the check that all weights are finite.
///
/// # Errors
/// Fails if there are incomplete genomes or no seeds.
pub fn check_shape(
    architecture: &Architecture,
    genomes: &[f32],
    seeds: &[u64],
) -> Result<(), WorkError> {
    check_whole(architecture, genomes)?;
    if seeds.is_empty() {
        return Err(WorkError::NoEpisode);
    }
    Ok(())
}

fn check_whole(architecture: &Architecture, genomes: &[f32]) -> Result<(), WorkError> {
    let weights = architecture.weight_count();
    if genomes.len().is_multiple_of(weights) {
        return Ok(());
    }
    Err(WorkError::Shape {
        numbers: genomes.len(),
        weights,
    })
}

fn check_finite(architecture: &Architecture, genomes: &[f32]) -> Result<(), WorkError> {
    let weights = architecture.weight_count();
    let finite = |part: &[f32]| {
        part.iter()
            .fold(true, |all, weight| all & weight.is_finite())
    };
    if !genomes.chunks(TOGETHER).all(finite)
        && let Some(index) = genomes.iter().position(|weight| !weight.is_finite())
    {
        return Err(WorkError::NotFinite {
            candidate: index / weights,
            weight: index % weights,
        });
    }
    Ok(())
}

impl Work {
    /// Creates work. `architecture`: a controller specification as JSON, whose weights are ignored. `genomes`:
    /// (candidates, weights), row-major. `seeds`: one per episode.
    ///
    /// # Errors
    /// Fails if the specification is invalid, if there are incomplete genomes or values that are not finite, or if
    /// there are no seeds.
    pub fn new(architecture: &str, genomes: Vec<f32>, seeds: Vec<u64>) -> Result<Self, WorkError> {
        let read = Architecture::from_json(architecture)?;
        let specification = serde_json::from_str(architecture).unwrap_or_default();
        Self::of(read, specification, genomes, seeds)
    }

    /// Like [`new`](Self::new), with a specification that has already been parsed as `architecture`.
    ///
    /// # Errors
    /// See [`new`](Self::new).
    pub fn of(
        architecture: impl Into<Arc<Architecture>>,
        mut specification: Map<String, Value>,
        genomes: Vec<f32>,
        seeds: Vec<u64>,
    ) -> Result<Self, WorkError> {
        let architecture = architecture.into();
        check_work(&architecture, &genomes, &seeds)?;
        specification.remove("weights");
        Ok(Self {
            architecture,
            specification,
            genomes,
            forgotten: 0,
            seeds,
            sample: None,
            make: None,
            only: None,
            revised: false,
        })
    }

    /// Restricts the work to these evaluations, which were made before; all others count as ended.
    ///
    /// # Errors
    /// Fails if an evaluation is not part of the work.
    pub fn only(mut self, evaluations: Vec<Repetition>) -> Result<Self, WorkError> {
        let (candidates, episodes) = (self.candidates(), self.episodes());
        for (index, repetition) in evaluations.iter().enumerate() {
            if repetition.candidate >= candidates || repetition.episode >= episodes {
                return Err(WorkError::NoSuchEvaluation {
                    index,
                    candidate: repetition.candidate,
                    episode: repetition.episode,
                });
            }
        }
        self.only = Some(evaluations);
        Ok(self)
    }

    /// Returns the evaluations to which the work is restricted, if it is.
    #[must_use]
    pub fn repetitions(&self) -> Option<&[Repetition]> {
        self.only.as_deref()
    }

    /// Marks the work as revised: if candidates are returned one by one, those whose results are invalidated because
    /// their server is wrong are evaluated and returned again, until the work ends.
    #[must_use]
    pub fn revised(mut self) -> Self {
        self.revised = true;
        self
    }

    /// Returns whether candidates may be returned again.
    #[must_use]
    pub fn is_revised(&self) -> bool {
        self.revised
    }

    /// Like [`of`](Self::of) and [`sampled`](Self::sampled), with genomes that are generated only when needed here: for
    /// servers that cannot generate them, or for few candidates.
    ///
    /// # Errors
    /// Fails if the sample is invalid or does not match the controllers, or if there are no seeds.
    pub fn drawn(
        architecture: impl Into<Arc<Architecture>>,
        specification: Map<String, Value>,
        sample: Sample,
        make: MakeGenomes,
        seeds: Vec<u64>,
    ) -> Result<Self, WorkError> {
        let mut work = Self::of(architecture, specification, Vec::new(), seeds)?;
        work.make = Some(make);
        work.sampled(sample)
    }

    /// Declares that the genomes are from this sample; servers that can generate them get the sample instead.
    ///
    /// # Errors
    /// Fails if the sample is invalid or does not match the candidates or the controllers.
    pub fn sampled(mut self, sample: Sample) -> Result<Self, WorkError> {
        let (candidates, weights) = (self.candidates(), self.architecture.weight_count());
        let (count, genes) = (sample.count, sample.center.0.len());
        let fits =
            usize::try_from(count).is_ok_and(|count| self.make.is_some() || count == candidates);
        if !fits || genes != weights {
            return Err(WorkError::Sample(format!(
                "{count} candidates of {genes} genes, but there are {candidates} of {weights}"
            )));
        }
        if let Some(problem) = sample.problem() {
            return Err(WorkError::Sample(problem));
        }
        self.sample = Some(Box::new(sample));
        Ok(self)
    }

    /// Returns whether the genomes are from a sample.
    #[must_use]
    pub fn is_sampled(&self) -> bool {
        self.sample.is_some()
    }

    /// Returns the part of the sample for some candidates; `None` if there is no sample, or if the genomes are not
    /// larger.
    #[must_use]
    pub fn sample_of(&self, candidates: &Range<usize>) -> Option<Box<Sample>> {
        let whole = self
            .sample
            .as_deref()
            .filter(|_| candidates.len() >= MIN_SAMPLE)?;
        Some(Box::new(part(whole, candidates)))
    }

    /// Returns the architecture of all controllers.
    #[must_use]
    pub fn architecture(&self) -> &Arc<Architecture> {
        &self.architecture
    }

    /// Returns the specification of all controllers, without weights.
    #[must_use]
    pub fn specification(&self) -> &Map<String, Value> {
        &self.specification
    }

    /// Returns the kind of the controllers.
    #[must_use]
    pub fn kind(&self) -> Option<&str> {
        self.specification.get("kind").and_then(Value::as_str)
    }

    /// Returns the seed of each episode.
    #[must_use]
    pub fn seeds(&self) -> &[u64] {
        &self.seeds
    }

    /// Returns the genomes of some candidates that are not forgotten.
    #[must_use]
    pub fn genomes_of(&self, candidates: Range<usize>) -> Cow<'_, [f32]> {
        if let (Some(make), Some(whole)) = (self.make, &self.sample) {
            return Cow::Owned(make(&part(whole, &candidates)));
        }
        let weights = self.architecture.weight_count();
        let (start, end) = (
            candidates.start - self.forgotten,
            candidates.end - self.forgotten,
        );
        Cow::Borrowed(&self.genomes[start * weights..end * weights])
    }

    /// Returns the genomes of all candidates that are not forgotten; empty for [`drawn`](Self::drawn) work.
    #[must_use]
    pub fn into_genomes(self) -> Vec<f32> {
        self.genomes
    }

    /// Returns the number of candidates, including forgotten ones.
    #[must_use]
    pub fn candidates(&self) -> usize {
        match (self.make, &self.sample) {
            // The count has been checked.
            (Some(_), Some(sample)) => usize::try_from(sample.count).unwrap_or(usize::MAX),
            _ => self.forgotten + self.genomes.len() / self.architecture.weight_count(),
        }
    }

    /// Adds candidates at the end. `genomes`: (new candidates, weights), row-major.
    ///
    /// # Errors
    /// Fails if there are incomplete genomes or values that are not finite.
    pub fn extend(&mut self, genomes: &[f32]) -> Result<(), WorkError> {
        check_whole(&self.architecture, genomes)?;
        check_finite(&self.architecture, genomes)?;
        if self.make.is_some() {
            self.genomes = self
                .genomes_of(self.forgotten..self.candidates())
                .into_owned();
            self.make = None;
        }
        self.genomes.extend_from_slice(genomes);
        self.sample = None;
        Ok(())
    }

    /// Drops the genomes of all candidates before this one, which are no longer needed.
    pub fn forget_before(&mut self, candidate: usize) {
        if self.make.is_none() {
            let weights = self.architecture.weight_count();
            self.genomes.drain(..(candidate - self.forgotten) * weights);
        }
        self.forgotten = candidate;
    }

    /// Returns the number of episodes of each candidate.
    #[must_use]
    pub fn episodes(&self) -> usize {
        self.seeds.len()
    }

    /// Returns the number of evaluations, each of a candidate in an episode.
    #[must_use]
    pub fn len(&self) -> usize {
        self.candidates() * self.episodes()
    }

    /// Returns whether there are no evaluations.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns a candidate's controller in its initial state.
    ///
    /// # Errors
    /// Never fails for work that was checked by [`new`](Self::new).
    pub fn controller(&self, candidate: usize) -> Result<Controller, ControllerError> {
        let genome = self.genomes_of(candidate..candidate + 1);
        Controller::with_weights(&self.architecture, genome.into())
    }
}

/// Returns the part of a sample for some candidates.
fn part(whole: &Sample, candidates: &Range<usize>) -> Sample {
    Sample {
        first: whole.first + candidates.start as u64,
        count: candidates.len() as u64,
        ..whole.clone()
    }
}
