//! What is asked of the pool.

use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;

use serde_json::{Map, Value};
use swarmwright_controllers::{Architecture, Controller, ControllerError, SpecificationError};
use swarmwright_protocol::Sample;

/// Many controllers of one architecture, each to be run in the same episodes.
#[derive(Debug, Clone)]
pub struct Work {
    architecture: Arc<Architecture>,
    specification: Map<String, Value>,
    /// Those of candidate `forgotten` and later ones.
    genomes: Vec<f32>,
    forgotten: usize,
    seeds: Vec<u64>,
    /// The sample of all genomes, if servers can expand it.
    sample: Option<Box<Sample>>,
    /// Makes them here, where there is only the sample.
    make: Option<MakeGenomes>,
    /// What is evaluated; none: every candidate in every episode.
    only: Option<Vec<Repetition>>,
    /// Whether candidates whose results turn out to be worth nothing are handed out again.
    revised: bool,
}

/// One evaluation that is to be repeated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Repetition {
    /// Index of the candidate.
    pub candidate: usize,
    /// Index of the episode.
    pub episode: usize,
    /// The server that evaluated it before: another server gets it, if there is one.
    pub before: Option<u64>,
}

/// Makes the genomes of a sound sample, (candidates, weights) row-major.
pub type MakeGenomes = fn(&Sample) -> Vec<f32>;

/// Work that cannot be done.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum WorkError {
    /// The specification of the controllers is wrong.
    #[error(transparent)]
    Specification(#[from] SpecificationError),
    /// Genomes that are not whole.
    #[error(
        "genomes: {numbers} numbers are not a multiple of {weights}, the weights of a controller"
    )]
    Shape {
        /// Numbers given.
        numbers: usize,
        /// Weights of a controller.
        weights: usize,
    },
    /// A weight that is NaN or infinite.
    #[error("genomes[{candidate}][{weight}] is NaN or infinite")]
    NotFinite {
        /// Which genome.
        candidate: usize,
        /// Which of its weights.
        weight: usize,
    },
    /// A sample that cannot be made, or that has not as many candidates and genes as the genomes.
    #[error("sample: {0}")]
    Sample(String),
    /// Servers announce one of the numbers of sensors and actuators alone, of which controllers are made; which is missing.
    #[error("the servers do not announce their number of {0}; add `{0}:` to the experiment")]
    Unannounced(&'static str),
    /// No episode at all.
    #[error("seeds: expected at least one")]
    NoEpisode,
    /// An evaluation of a candidate or an episode that is not part of the work.
    #[error("only[{index}]: candidate {candidate} or episode {episode} does not exist")]
    NoSuchEvaluation {
        /// Which of the evaluations.
        index: usize,
        /// Its candidate.
        candidate: usize,
        /// Its episode.
        episode: usize,
    },
}

/// Candidates whose genomes take more room than the distribution that they are from: six rows of binary64.
const MIN_SAMPLE: usize = 16;
/// Number of values that are checked together, since the compiler vectorizes only loops without an early exit.
const TOGETHER: usize = 1024;

/// Whether genomes and seeds are some work for controllers that have this in common.
///
/// # Errors
/// As for [`Work::new`].
pub fn check_work(
    architecture: &Architecture,
    genomes: &[f32],
    seeds: &[u64],
) -> Result<(), WorkError> {
    check_shape(architecture, genomes, seeds)?;
    check_finite(architecture, genomes)
}

/// As [`check_work`], for whom sees weights that are not finite numbers without it.
///
/// # Errors
/// Genomes that are not whole, no seed.
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
    /// `architecture`: a controller specification as JSON, its weights ignored. `genomes`: (candidates, weights),
    /// row-major. `seeds`: one per episode.
    ///
    /// # Errors
    /// A specification that is wrong; numbers that are not finite or not whole genomes; no seed.
    pub fn new(architecture: &str, genomes: Vec<f32>, seeds: Vec<u64>) -> Result<Self, WorkError> {
        let read = Architecture::from_json(architecture)?;
        let specification = serde_json::from_str(architecture).unwrap_or_default();
        Self::of(read, specification, genomes, seeds)
    }

    /// As [`new`](Self::new), where the specification has been read as `architecture`.
    ///
    /// # Errors
    /// As [`new`](Self::new).
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
    /// An evaluation of a candidate or an episode that is not part of the work.
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

    /// The evaluations to which the work is restricted, if it is.
    #[must_use]
    pub fn repetitions(&self) -> Option<&[Repetition]> {
        self.only.as_deref()
    }

    /// Where candidates are handed out one by one: those whose results turn out to be worth nothing, as their server is wrong, are
    /// evaluated and handed out again, until the work ends.
    #[must_use]
    pub fn revised(mut self) -> Self {
        self.revised = true;
        self
    }

    /// Whether candidates may be handed out again.
    #[must_use]
    pub fn is_revised(&self) -> bool {
        self.revised
    }

    /// As [`of`](Self::of) and [`sampled`](Self::sampled), with genomes that are made when one is needed here: for servers that
    /// cannot make them, or few candidates.
    ///
    /// # Errors
    /// A sample that cannot be made, or of other controllers; no seed.
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

    /// The genomes are those of this sample: servers that can make them get it instead.
    ///
    /// # Errors
    /// A sample that cannot be made, or of other candidates or controllers.
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

    /// Whether the genomes are those of a sample.
    #[must_use]
    pub fn is_sampled(&self) -> bool {
        self.sample.is_some()
    }

    /// The part of the sample that is some candidates; none if there is no sample, or the genomes are not longer.
    #[must_use]
    pub fn sample_of(&self, candidates: &Range<usize>) -> Option<Box<Sample>> {
        let whole = self
            .sample
            .as_deref()
            .filter(|_| candidates.len() >= MIN_SAMPLE)?;
        Some(Box::new(part(whole, candidates)))
    }

    /// What all controllers have in common.
    #[must_use]
    pub fn architecture(&self) -> &Arc<Architecture> {
        &self.architecture
    }

    /// The specification of all controllers, without weights.
    #[must_use]
    pub fn specification(&self) -> &Map<String, Value> {
        &self.specification
    }

    /// The controllers' kind.
    #[must_use]
    pub fn kind(&self) -> Option<&str> {
        self.specification.get("kind").and_then(Value::as_str)
    }

    /// The seed of each episode.
    #[must_use]
    pub fn seeds(&self) -> &[u64] {
        &self.seeds
    }

    /// The genomes of some candidates that are not forgotten.
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

    /// The genomes of all candidates that are not forgotten; none of [`drawn`](Self::drawn) work.
    #[must_use]
    pub fn into_genomes(self) -> Vec<f32> {
        self.genomes
    }

    /// Number of candidates, forgotten ones included.
    #[must_use]
    pub fn candidates(&self) -> usize {
        match (self.make, &self.sample) {
            // It was checked that there are no more.
            (Some(_), Some(sample)) => usize::try_from(sample.count).unwrap_or(usize::MAX),
            _ => self.forgotten + self.genomes.len() / self.architecture.weight_count(),
        }
    }

    /// Adds candidates behind the others. `genomes`: (more candidates, weights), row-major.
    ///
    /// # Errors
    /// Numbers that are not finite or not whole genomes.
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

    /// Number of episodes of each candidate.
    #[must_use]
    pub fn episodes(&self) -> usize {
        self.seeds.len()
    }

    /// Number of evaluations: a candidate in an episode.
    #[must_use]
    pub fn len(&self) -> usize {
        self.candidates() * self.episodes()
    }

    /// Whether there is nothing to do.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// A candidate's controller at the start of an episode.
    ///
    /// # Errors
    /// None for work that was checked by [`new`](Self::new).
    pub fn controller(&self, candidate: usize) -> Result<Controller, ControllerError> {
        let genome = self.genomes_of(candidate..candidate + 1);
        Controller::with_weights(&self.architecture, genome.into())
    }
}

/// Some candidates of a sample.
fn part(whole: &Sample, candidates: &Range<usize>) -> Sample {
    Sample {
        first: whole.first + candidates.start as u64,
        count: candidates.len() as u64,
        ..whole.clone()
    }
}
