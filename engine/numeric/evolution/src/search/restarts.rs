//! CMA-ES from one start to the next: IPOP (Auger and Hansen, CEC 2005) and BIPOP (Hansen, GECCO 2009 BBOB).

use super::gaussian::count;
use super::{Search, Starts, Unavailable};
use crate::cma::{Cma, Start, Stop};
use crate::stream::{Stream, purpose_key};

/// Reaction to a stopping criterion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Restarts {
    /// Samples of the same distribution.
    None,
    /// A new start with twice the population.
    Doubled,
    /// Such starts, and between them ones with small populations and steps, which get as many evaluations.
    Two,
}

/// Settings of a search by CMA-ES.
#[derive(Debug, Clone, PartialEq)]
pub struct CmaSettings {
    /// Half of the initial range of each gene.
    pub reach: Vec<f64>,
    /// Least value of each gene, minus infinity where there is none.
    pub lower: Vec<f64>,
    /// Largest value of each gene, infinity where there is none.
    pub upper: Vec<f64>,
    /// Initial standard deviation, as a share of `reach`.
    pub step: f64,
    /// Genomes of each generation of the first start.
    pub population: usize,
    /// Whether the covariance matrix stays diagonal.
    pub separable: bool,
    /// Reaction to a stopping criterion.
    pub restarts: Restarts,
    /// Evaluations of the whole run.
    pub budget: u64,
}

/// A search by CMA-ES with restarts.
pub struct CmaSearch {
    settings: CmaSettings,
    seed: u64,
    purpose: u64,
    generation: u64,
    evaluations: u64,
    /// Center of the first start.
    center: Vec<f64>,
    /// Centers of the next ones, by their number.
    starts: Starts,
    /// How often it has begun.
    begun: u64,
    regimes: Regimes,
    size: usize,
    search: Option<Cma>,
    stopped: Vec<&'static str>,
}

impl CmaSearch {
    /// `address`: seed and kind. `center`: genes of the first start. `starts`: those of the next ones, by number.
    #[must_use]
    pub fn new(
        (seed, kind): (u64, &str),
        center: Vec<f64>,
        settings: CmaSettings,
        starts: Starts,
    ) -> Self {
        Self {
            seed,
            purpose: purpose_key(&format!("{kind}.direction")),
            generation: 0,
            evaluations: 0,
            center,
            starts,
            begun: 0,
            regimes: Regimes::new(settings.restarts, settings.population),
            size: settings.population,
            search: None,
            stopped: Vec::new(),
            settings,
        }
    }

    fn begin(&mut self) -> Result<Cma, Unavailable> {
        let mut share = 1.0;
        if self.begun > 0 {
            self.center = (self.starts)(self.begun)?;
            let mut stream = Stream::new(self.seed, purpose_key("cma.regime"), self.begun, 0);
            let left = self.settings.budget.saturating_sub(self.evaluations);
            let (draw, other) = (stream.unit(), stream.unit());
            (self.size, share) = self.regimes.begin(draw, other, left);
        }
        self.begun += 1;
        Ok(Cma::new(Start {
            center: &self.center,
            reach: &self.settings.reach,
            lower: &self.settings.lower,
            upper: &self.settings.upper,
            step: self.settings.step * share,
            population: self.size,
            separable: self.settings.separable,
        }))
    }
}

impl Search for CmaSearch {
    fn ask(&mut self) -> Result<Vec<f32>, Unavailable> {
        let mut search = match self.search.take() {
            Some(search) => search,
            None => self.begin()?,
        };
        let stream = |candidate| Stream::new(self.seed, self.purpose, self.generation, candidate);
        let mut streams: Vec<_> = (0..self.size as u64).map(stream).collect();
        let mut genomes = vec![0.0; self.size * self.center.len()];
        search.ask(&mut streams, &mut genomes);
        self.search = Some(search);
        Ok(genomes)
    }

    fn tell(&mut self, _genomes: &[f32], fitness: &[f64]) -> Result<(), Unavailable> {
        assert_eq!(fitness.len(), self.size);
        self.generation += 1;
        self.evaluations += fitness.len() as u64;
        self.regimes.spent(fitness.len());
        if fitness.iter().all(|value| value.is_nan()) {
            return Ok(());
        }
        let stop = self.search.as_mut().and_then(|search| search.tell(fitness));
        let endless = stop == Some(Stop::Infinite);
        let why = match stop {
            None if self.regimes.over() => Some("share"),
            other => other.map(Stop::name),
        };
        // Without restarts the same distribution is sampled on and on, as long as it can be.
        if let Some(why) = why
            && (endless || self.settings.restarts != Restarts::None)
        {
            self.stopped.push(why);
            self.search = None;
        }
        Ok(())
    }

    fn stopped(&self) -> &[&'static str] {
        &self.stopped
    }

    fn state(&self, name: &str) -> Option<Vec<f64>> {
        let search = self.search.as_ref();
        match name {
            #[expect(clippy::cast_precision_loss, reason = "starts are few")]
            "starts" => Some(vec![self.begun as f64]),
            "sigma" => search.map(|search| vec![search.sigma()]),
            "mean" => search.map(|search| search.mean().to_vec()),
            "step_path" => search.map(|search| search.step_path().to_vec()),
            _ => None,
        }
    }
}

/// How large the next start is.
#[derive(Debug, Clone)]
struct Regimes {
    restarts: Restarts,
    population: usize,
    doublings: u32,
    /// Evaluations of small and of large starts; the first one counts as small.
    spent: [u64; 2],
    large: bool,
    /// Evaluations of the start that is under way, and how many it gets.
    here: u64,
    most: f64,
}

impl Regimes {
    fn new(restarts: Restarts, population: usize) -> Self {
        Self {
            restarts,
            population,
            doublings: 0,
            spent: [0, 0],
            large: false,
            here: 0,
            most: f64::INFINITY,
        }
    }

    /// Counts evaluations of the start that is under way.
    fn spent(&mut self, evaluations: usize) {
        self.spent[usize::from(self.large)] += evaluations as u64;
        self.here += evaluations as u64;
    }

    /// Whether the start that is under way has had its share.
    fn over(&self) -> bool {
        number(self.here) >= self.most
    }

    /// The population and the share of the initial step of the next start; `draw` and `other` are uniform in 0 .. 1, and `left` are the
    /// evaluations that are left, to which large populations are cut, though not below the first.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "populations are small"
    )]
    fn begin(&mut self, draw: f64, other: f64, left: u64) -> (usize, f64) {
        (self.here, self.most) = (0, f64::INFINITY);
        if self.restarts == Restarts::None {
            // Only where numbers have become infinite.
            return (self.population, 1.0);
        }
        if self.restarts == Restarts::Two && self.spent[0] < self.spent[1] {
            self.large = false;
            self.most = number(self.spent[1]) / 2.0;
            let first = count(self.population);
            let factor = power(count(self.doubled()) / 2.0 / first, draw * draw);
            let size = (first * factor) as usize;
            return (self.population.max(size), power(10.0, -2.0 * other));
        }
        self.large = true;
        self.doublings += 1;
        let left = usize::try_from(left).unwrap_or(usize::MAX);
        (self.population.max(self.doubled().min(left)), 1.0)
    }

    fn doubled(&self) -> usize {
        self.population
            .saturating_mul(1_usize.checked_shl(self.doublings).unwrap_or(usize::MAX))
    }
}

#[expect(clippy::cast_precision_loss, reason = "evaluations are below 2^53")]
fn number(evaluations: u64) -> f64 {
    evaluations as f64
}

/// A power of a positive number.
fn power(base: f64, exponent: f64) -> f64 {
    libm::exp(exponent * libm::log(base))
}

#[cfg(test)]
mod tests {
    use super::{Regimes, Restarts};

    #[test]
    fn small_and_large_populations_get_the_same() {
        let mut regimes = Regimes::new(Restarts::Two, 10);
        regimes.spent(1000);
        let mut spent = [1000, 0];
        for _ in 0..12 {
            let (population, share) = regimes.begin(0.5, 0.5, 1_000_000_000);
            let large = share == 1.0;
            assert_eq!(large, spent[0] >= spent[1]);
            assert!(population >= 10);
            regimes.spent(100 * population);
            spent[usize::from(large)] += 100 * population;
        }
        // A small start ends when it has had half of what large ones had.
        while regimes.begin(0.5, 0.5, 1_000_000_000).1 == 1.0 {
            regimes.spent(10);
        }
        let half = usize::try_from(regimes.spent[1] / 2).unwrap_or_default();
        regimes.spent(half - 1);
        assert!(!regimes.over());
        regimes.spent(2);
        assert!(regimes.over());
    }

    #[test]
    fn no_population_is_larger_than_what_is_left() {
        let mut regimes = Regimes::new(Restarts::Doubled, 10);
        assert_eq!(regimes.begin(0.0, 0.0, 1000), (20, 1.0));
        assert_eq!(regimes.begin(0.0, 0.0, 33), (33, 1.0));
        assert_eq!(regimes.begin(0.0, 0.0, 4), (10, 1.0));
    }
}
