//! Methods that the engine knows wholly, as conversations.
#![expect(
    clippy::needless_pass_by_value,
    reason = "pyo3 hands arguments over by value"
)]

use numpy::{
    PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use swarmwright_evolution::{
    Base, Bounded, Challenger, CmaSearch, CmaSettings, Compatibility, Crossover, Differential,
    Evostick, EvostickSettings, Gaussian, Genetic, GeneticSettings, Learning, Neat, NeatSettings,
    Nes, NesSettings, Restart, Restarts, Search, Space, Starts, SwarmSettings, Swarming,
    Unavailable, Variation, WeightMutation,
};

use crate::conversation::{Conversation, Failure};
use crate::errors::input;
use crate::evolution::PyGrowingNetwork;
use crate::local::lock;
use crate::operators::operators;
use crate::sample::PySample;
use crate::threads;

type Row<'py> = PyReadonlyArray1<'py, f64>;

/// A method: it asks for evaluations and learns from what came out, generation after generation.
#[pyclass(name = "Search", module = "swarmwright._engine")]
pub struct PySearch {
    /// None once it was handed over.
    search: Option<Conversation>,
}

impl PySearch {
    fn new(genes: usize, search: impl Search + 'static, failed: Failure) -> PyResult<Self> {
        threads::start()?;
        Ok(Self {
            search: Some(Conversation::new(genes, search, failed)),
        })
    }

    fn here(&mut self) -> PyResult<&mut Conversation> {
        self.search.as_mut().ok_or_else(elsewhere)
    }

    /// Hands it over to the caller, who goes on with it.
    pub fn take(&mut self) -> PyResult<Conversation> {
        self.search.take().ok_or_else(elsewhere)
    }
}

/// Genomes as the store has them.
#[derive(FromPyObject)]
pub enum StoredGenomes<'py> {
    Sample(Bound<'py, PySample>),
    Genomes(PyReadonlyArray2<'py, f32>),
}

fn elsewhere() -> PyErr {
    input("the search belongs to a producer")
}

#[pymethods]
impl PySearch {
    #[staticmethod]
    #[pyo3(signature = (seed, kind, *, space, start, population, noise, step, learning))]
    #[expect(clippy::too_many_arguments, reason = "keywords in Python")]
    fn pairs(
        seed: u64,
        kind: &str,
        space: (Row<'_>, Row<'_>, Row<'_>, Row<'_>),
        start: Option<Row<'_>>,
        population: usize,
        noise: f64,
        step: f64,
        learning: Vec<f64>,
    ) -> PyResult<Self> {
        let space = self::space(&space)?;
        let genes = space.middle.len();
        let start = start.map(|start| of_each(&start, genes)).transpose()?;
        let learning = match learning[..] {
            [decay] => Learning::Decay(decay),
            [rate, change] => Learning::Deviations { rate, change },
            _ => return Err(input("learning: expected decay, or rate and change")),
        };
        if population < 2 || population % 2 == 1 {
            return Err(input(format!(
                "population: {population} found, expected an even number"
            )));
        }
        let numbers = (noise, step);
        let search = Gaussian::new(
            (seed, kind),
            space,
            start.as_deref(),
            population,
            numbers,
            learning,
        );
        Self::new(genes, search, Failure::default())
    }

    #[staticmethod]
    #[pyo3(signature = (seed, kind, *, space, start, starts, population, step, rate, separable, restart))]
    #[expect(clippy::too_many_arguments, reason = "keywords in Python")]
    fn nes(
        seed: u64,
        kind: &str,
        space: (Row<'_>, Row<'_>, Row<'_>, Row<'_>),
        start: Option<Row<'_>>,
        starts: Py<PyAny>,
        population: usize,
        step: f64,
        rate: f64,
        separable: bool,
        restart: &str,
    ) -> PyResult<Self> {
        let space = self::space(&space)?;
        let genes = space.middle.len();
        let start = start.map(|start| of_each(&start, genes)).transpose()?;
        let settings = NesSettings {
            population: at_least(population, 2)?,
            step,
            rate,
            separable,
            restart: match restart {
                "none" => Restart::None,
                "same" => Restart::Same,
                "ipop" => Restart::Doubled,
                other => return Err(unknown("restart", other)),
            },
        };
        let (starts, failed) = self::starts(starts, genes);
        let search = Nes::new((seed, kind), space, start.as_deref(), settings, starts);
        Self::new(genes, search, failed)
    }

    #[staticmethod]
    #[pyo3(signature = (seed, kind, *, center, starts, reach, lower, upper, step, population, separable, restart, budget))]
    #[expect(clippy::too_many_arguments, reason = "keywords in Python")]
    fn cma(
        seed: u64,
        kind: &str,
        center: Row<'_>,
        starts: Py<PyAny>,
        reach: Row<'_>,
        lower: Row<'_>,
        upper: Row<'_>,
        step: f64,
        population: usize,
        separable: bool,
        restart: &str,
        budget: u64,
    ) -> PyResult<Self> {
        let genes = at_least(center.len(), 1)?;
        let settings = CmaSettings {
            reach: of_each(&reach, genes)?,
            lower: of_each(&lower, genes)?,
            upper: of_each(&upper, genes)?,
            step,
            population: at_least(population, 3)?,
            separable,
            restarts: match restart {
                "none" => Restarts::None,
                "ipop" => Restarts::Doubled,
                "bipop" => Restarts::Two,
                other => return Err(unknown("restart", other)),
            },
            budget,
        };
        let (starts, failed) = self::starts(starts, genes);
        let center = center.as_slice()?.to_vec();
        let search = CmaSearch::new((seed, kind), center, settings, starts);
        Self::new(genes, search, failed)
    }

    #[staticmethod]
    #[pyo3(signature = (seed, kind, *, first, lower, upper, inertia, pulls, fastest, adaptive, perturb))]
    #[expect(clippy::too_many_arguments, reason = "keywords in Python")]
    fn swarm(
        seed: u64,
        kind: &str,
        first: PyReadonlyArray2<'_, f32>,
        lower: Row<'_>,
        upper: Row<'_>,
        inertia: f64,
        pulls: (f64, f64),
        fastest: f64,
        adaptive: bool,
        perturb: bool,
    ) -> PyResult<Self> {
        let challenger = Challenger::Swarm(Swarming::new(SwarmSettings {
            inertia,
            pulls,
            fastest,
            adaptive,
            perturb,
        }));
        at_least(first.shape()[0], 2)?;
        bounded(seed, kind, &first, (&lower, &upper), challenger)
    }

    #[staticmethod]
    #[pyo3(signature = (seed, kind, *, first, lower, upper, base, crossover, factor, rate, mutate))]
    #[expect(clippy::too_many_arguments, reason = "keywords in Python")]
    fn differential(
        seed: u64,
        kind: &str,
        first: PyReadonlyArray2<'_, f32>,
        lower: Row<'_>,
        upper: Row<'_>,
        base: &str,
        crossover: &str,
        factor: f64,
        rate: f64,
        mutate: f64,
    ) -> PyResult<Self> {
        let challenger = Challenger::Differential(Differential {
            base: match base {
                "best" => Base::Best,
                "rand" => Base::Random,
                "target-to-best" => Base::TargetToBest,
                other => return Err(unknown("base", other)),
            },
            crossover: match crossover {
                "bin" => Crossover::Binomial,
                "exp" => Crossover::Exponential,
                "hypercube" => Crossover::Hypercube,
                "line" => Crossover::Line,
                other => return Err(unknown("crossover", other)),
            },
            factor,
            rate,
            mutate,
        });
        at_least(first.shape()[0], 4)?;
        bounded(seed, kind, &first, (&lower, &upper), challenger)
    }

    #[staticmethod]
    #[pyo3(signature = (seed, kind, *, first, elites, middle, step, lower, upper))]
    #[expect(clippy::too_many_arguments, reason = "keywords in Python")]
    fn evostick(
        seed: u64,
        kind: &str,
        first: PyReadonlyArray2<'_, f32>,
        elites: usize,
        middle: Row<'_>,
        step: Row<'_>,
        lower: Row<'_>,
        upper: Row<'_>,
    ) -> PyResult<Self> {
        let genes = at_least(first.shape()[1], 1)?;
        at_least(first.shape()[0], at_least(elites, 1)?)?;
        let settings = EvostickSettings {
            elites,
            middle: of_each(&middle, genes)?,
            step: of_each(&step, genes)?,
            lower: of_each(&lower, genes)?,
            upper: of_each(&upper, genes)?,
        };
        let search = Evostick::new((seed, kind), first.as_slice()?.to_vec(), settings);
        Self::new(genes, search, Failure::default())
    }

    #[staticmethod]
    #[pyo3(signature = (seed, kind, *, first, operators, populations, shares, severity, probability, partners, exchange_interval, exchange))]
    #[expect(clippy::too_many_arguments, reason = "keywords in Python")]
    fn genetic(
        seed: u64,
        kind: &str,
        first: PyReadonlyArray2<'_, f32>,
        operators: &Bound<'_, PyAny>,
        populations: usize,
        shares: [usize; 4],
        severity: f64,
        probability: f64,
        partners: usize,
        exchange_interval: u64,
        exchange: f64,
    ) -> PyResult<Self> {
        let [elite, random, mutate, crossover] = shares;
        let genes = at_least(first.shape()[1], 1)?;
        let members = first.shape()[0] / at_least(populations, 1)?;
        let settings = GeneticSettings {
            populations,
            members,
            elite,
            random,
            mutate,
            crossover,
            variation: Variation {
                severity,
                probability,
            },
            partners: at_least(partners, 1)?,
            exchange_interval,
            exchange,
        };
        let total = shares
            .iter()
            .try_fold(0, |sum: usize, share| sum.checked_add(*share));
        if members * populations != first.shape()[0] || total.is_none_or(|total| total > members) {
            return Err(input(format!(
                "first, shares: {} genomes and {shares:?} members do not make {populations} populations",
                first.shape()[0]
            )));
        }
        let failed = Failure::default();
        let operators = self::operators(operators, genes, failed.clone())?;
        let first = first.as_slice()?.to_vec();
        let search = Genetic::new((seed, kind), first, settings, operators);
        Self::new(genes, search, failed)
    }

    #[staticmethod]
    #[pyo3(signature = (seed, kind, *, first, operators, compatibility, threshold, species, survival, stagnation, mutate_only, interspecies, weights))]
    #[expect(clippy::too_many_arguments, reason = "keywords in Python")]
    fn neat(
        seed: u64,
        kind: &str,
        first: PyReadonlyArray2<'_, f32>,
        operators: &Bound<'_, PyGrowingNetwork>,
        compatibility: (f64, f64),
        threshold: f64,
        species: Option<usize>,
        survival: f64,
        stagnation: u64,
        mutate_only: f64,
        interspecies: f64,
        weights: (f64, f64, f64),
    ) -> PyResult<Self> {
        let operators = operators.get().0.clone();
        let genes = operators.genes();
        at_least(first.shape()[0], 1)?;
        if first.shape()[1] != genes {
            let actual = first.shape()[1];
            return Err(input(format!(
                "first: {actual} genes found, expected {genes}"
            )));
        }
        let settings = NeatSettings {
            compatibility: Compatibility {
                disjoint: compatibility.0,
                weights: compatibility.1,
            },
            threshold,
            species,
            survival,
            stagnation,
            mutate_only,
            interspecies,
            weights: WeightMutation {
                genomes: weights.0,
                each: weights.1,
                severity: weights.2,
            },
        };
        let search = Neat::new(
            (seed, kind),
            first.as_slice()?.to_vec(),
            operators,
            settings,
        );
        Self::new(genes, search, Failure::default())
    }

    fn ask<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let conversation = self.here()?;
        let genes = conversation.genes();
        let genomes = py.detach(|| conversation.ask())?;
        PyArray1::from_slice(py, genomes).reshape([genomes.len() / genes.max(1), genes])
    }

    fn tell(&mut self, py: Python<'_>, fitness: Row<'_>) -> PyResult<()> {
        let conversation = self.here()?;
        let fitness = fitness.as_slice()?;
        py.detach(|| conversation.tell(fitness)).map(|_| ())
    }

    /// Asks, and tells the fitness of these genomes if they are those asked for; returns whether they are.
    fn retell(
        &mut self,
        py: Python<'_>,
        genomes: StoredGenomes<'_>,
        fitness: Row<'_>,
    ) -> PyResult<bool> {
        let conversation = self.here()?;
        let fitness = fitness.as_slice()?;
        let genomes = match &genomes {
            StoredGenomes::Sample(sample) => {
                let sample = &sample.get().0;
                return py.detach(|| conversation.retell_sample(sample, fitness));
            }
            StoredGenomes::Genomes(genomes) => genomes.as_slice()?,
        };
        py.detach(|| conversation.retell(genomes, fitness))
    }

    fn rescore(&mut self, fitness: Row<'_>) -> PyResult<()> {
        let conversation = self.here()?;
        let members = conversation.members().unwrap_or_default().len();
        conversation.search.rescore(&of_each(&fitness, members)?);
        Ok(())
    }

    #[getter]
    fn members<'py>(&mut self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f32>>>> {
        let conversation = self.here()?;
        let genes = conversation.genes();
        let Some(members) = conversation.search.members() else {
            return Ok(None);
        };
        let genomes = PyArray1::from_slice(py, members.genomes);
        genomes.reshape([members.fitness.len(), genes]).map(Some)
    }

    #[getter]
    fn fitness<'py>(&mut self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray1<f64>>>> {
        let members = self.here()?.search.members();
        Ok(members.map(|members| PyArray1::from_slice(py, members.fitness)))
    }

    #[getter]
    fn stopped(&mut self) -> PyResult<Vec<&'static str>> {
        Ok(self.here()?.search.stopped().to_vec())
    }

    /// What all genomes asked for last were made from, where servers can make them from it, too.
    #[getter]
    fn sample(&mut self) -> PyResult<Option<PySample>> {
        let conversation = self.here()?;
        Ok(conversation
            .sample(conversation.candidate_count())
            .map(PySample))
    }

    fn state<'py>(&mut self, py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let state = self.here()?.search.state(name);
        let state = state.ok_or_else(|| unknown("name", name))?;
        Ok(PyArray1::from_vec(py, state))
    }
}

fn bounded(
    seed: u64,
    kind: &str,
    first: &PyReadonlyArray2<'_, f32>,
    (lower, upper): (&Row<'_>, &Row<'_>),
    challenger: Challenger,
) -> PyResult<PySearch> {
    let genes = first.shape()[1];
    let bounds = (of_each(lower, genes)?, of_each(upper, genes)?);
    let first = first.as_slice()?.to_vec();
    let search = Bounded::new((seed, kind), bounds, first, challenger);
    PySearch::new(genes, search, Failure::default())
}

fn space((middle, reach, lower, upper): &(Row<'_>, Row<'_>, Row<'_>, Row<'_>)) -> PyResult<Space> {
    let genes = middle.len();
    Ok(Space {
        middle: middle.as_slice()?.to_vec(),
        reach: of_each(reach, genes)?,
        lower: of_each(lower, genes)?,
        upper: of_each(upper, genes)?,
    })
}

/// New starts from a callable in Python, and where its error goes.
fn starts(callable: Py<PyAny>, genes: usize) -> (Starts, Failure) {
    let failed = Failure::default();
    let slot = failed.clone();
    let start = move |number: u64| {
        Python::attach(|py| {
            let values = callable.call1(py, (number,))?;
            of_each(&values.extract::<Row<'_>>(py)?, genes)
        })
        .map_err(|error: PyErr| {
            *lock(&slot) = Some(error);
            Unavailable
        })
    };
    (Box::new(start), failed)
}

fn of_each(values: &Row<'_>, expected: usize) -> PyResult<Vec<f64>> {
    if values.len() != expected {
        let count = values.len();
        return Err(input(format!("expected {expected} values, found {count}")));
    }
    Ok(values.as_slice()?.to_vec())
}

fn at_least(number: usize, least: usize) -> PyResult<usize> {
    if number < least {
        return Err(input(format!("{number} found, expected at least {least}")));
    }
    Ok(number)
}

fn unknown(name: &str, value: &str) -> PyErr {
    input(format!("{name}: unknown: {value}"))
}
