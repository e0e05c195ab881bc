//! The optimization tool's side of the broker.

use std::sync::Arc;

use numpy::{PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde::Serialize;
use serde_json::Value;
use swarmwright_pool::{About, Demand, Options, Pool, PoolError, Repetition, Report, Timeouts};
use swarmwright_protocol::{AnnouncedSide, Requirements};

use crate::account::{Account, settings};
use crate::errors::{NoServerError, engine, input, unconnected};
use crate::genomes::{architecture, work};
use crate::producer::Borrower;
use crate::results::{Fitness, Metrics, arrays};
use crate::sample::PySample;
use crate::supervision::PySupervision;
use crate::values::{object, read, to_python};

/// An [`Attempt`] or a warning, its fields by their names.
pub type Fields<'py> = Bound<'py, PyAny>;

/// Fitness, metrics, attempts, warnings.
type Evaluated<'py> = (
    Fitness<'py>,
    Metrics<'py>,
    Vec<Fields<'py>>,
    Vec<Fields<'py>>,
);

/// Finds servers and runs episodes on them.
/// A server's declaration: id, determinism and tolerance.
type Declared = (u64, Option<String>, Option<f64>);

#[pyclass(name = "Pool", module = "swarmwright._engine")]
pub struct PyPool {
    /// None once it is closed.
    pool: Option<Pool>,
    /// A producer has it.
    lent: bool,
    /// Its thread, once there is one.
    borrower: Option<Arc<Borrower>>,
    /// Number of metrics that are needed of every episode.
    metrics: usize,
}

pub fn error(error: &PoolError) -> PyErr {
    match error {
        PoolError::Settings(_) | PoolError::Topic(_) | PoolError::NoSizes | PoolError::Work(_) => {
            input(error)
        }
        PoolError::Connect(error) => unconnected(error),
        PoolError::NoServer { nothing: true, .. } => NoServerError::new_err(error.to_string()),
        _ => engine(error),
    }
}

#[pymethods]
impl PyPool {
    #[new]
    #[pyo3(signature = (broker, *, simulation, parameters, requirements, sensors=None, actuators=None, prefix="", tool="",
        mode="auto", metrics=None, visual=false, timeouts=None, faults=None, largest=None, alone=false, controller=None, account=None))]
    #[expect(clippy::too_many_arguments, reason = "keywords in Python")]
    fn new(
        py: Python<'_>,
        broker: &str,
        simulation: String,
        parameters: &Bound<'_, PyDict>,
        requirements: &Bound<'_, PyDict>,
        sensors: Option<usize>,
        actuators: Option<usize>,
        prefix: &str,
        tool: &str,
        mode: &str,
        metrics: Option<Vec<String>>,
        visual: bool,
        timeouts: Option<&Bound<'_, PyDict>>,
        faults: Option<&Bound<'_, PyDict>>,
        largest: Option<usize>,
        alone: bool,
        controller: Option<&Bound<'_, PyDict>>,
        account: Option<Account>,
    ) -> PyResult<Self> {
        let requirements = Requirements::from_object(object("requirements", requirements)?)
            .map_err(|error| input(format!("requirements: {error}")))?;
        let needed = metrics.unwrap_or_default();
        let metrics = needed.len();
        let timeouts = timeouts
            .map(|section| read("timeouts", section))
            .transpose()?;
        let timeouts: Timeouts = timeouts.unwrap_or_default();
        let faults = faults.map(|section| read("faults", section)).transpose()?;
        let mut settings = settings(broker, account)?;
        settings.keep_alive = timeouts.keep_alive.unwrap_or(settings.keep_alive);
        let mut demand = Demand {
            simulation,
            requirements,
            sensors,
            actuators,
            mode: mode.parse().map_err(input)?,
            kind: None,
            modules: Vec::new(),
            metrics: needed,
        };
        if let Some(controller) = controller {
            let (architecture, specification) = architecture(controller)?;
            let kind = specification.get("kind").and_then(Value::as_str);
            demand.set_controllers(kind, &architecture);
        }
        let options = Options {
            settings,
            prefix: prefix.to_owned(),
            tool: tool.to_owned(),
            demand,
            parameters: object("parameters", parameters)?,
            visual,
            timeouts,
            faults: faults.unwrap_or_default(),
            largest: largest.unwrap_or(usize::MAX),
            alone,
        };
        py.detach(|| Pool::connect(options))
            .map(|pool| Self {
                pool: Some(pool),
                lent: false,
                borrower: None,
                metrics,
            })
            .map_err(|failed| error(&failed))
    }

    #[pyo3(signature = (*, sizes=true))]
    fn wait_for_server(&mut self, py: Python<'_>, sizes: bool) -> PyResult<(usize, usize)> {
        let pool = self.pool()?;
        let mut raised = None;
        let result = py.detach(|| {
            pool.wait_for_server(sizes, |_| {
                Python::attach(|py| py.check_signals())
                    .map_err(|error| raised = Some(error))
                    .is_ok()
            })
        });
        raised.map_or(Ok(()), Err)?;
        result.map_err(|failed| error(&failed))
    }

    /// The processes of these servers are the caller's own.
    fn watch(&mut self, servers: Vec<u64>) -> PyResult<PySupervision> {
        Ok(PySupervision(self.pool()?.watch(servers)))
    }

    /// Calls `on_report` with each report, a dict; what it raises is dropped.
    #[pyo3(signature = (on_report, *, warnings_only=false))]
    fn listen(&mut self, on_report: Py<PyAny>, warnings_only: bool) -> PyResult<()> {
        self.pool()?.listen(Box::new(move |report: &Report<'_>| {
            let is_warning = matches!(
                report,
                Report::Warning { .. } | Report::BrokerLost { .. } | Report::BrokerBack
            );
            if warnings_only && !is_warning {
                return;
            }
            Python::attach(|py| {
                let called =
                    to_python(py, report).and_then(|report| on_report.call1(py, (report,)));
                if let Err(error) = called {
                    error.write_unraisable(py, None);
                }
            });
        }));
        Ok(())
    }

    #[pyo3(signature = (run=None, generation=None, generations=None, evaluations=None, purpose=None))]
    fn about(
        &mut self,
        run: Option<String>,
        generation: Option<u64>,
        generations: Option<u64>,
        evaluations: Option<(u64, u64)>,
        purpose: Option<String>,
    ) -> PyResult<()> {
        self.pool()?.set_about(About {
            run,
            generation,
            generations,
            evaluations,
            purpose,
        });
        Ok(())
    }

    /// Incidents so far, by name.
    fn counts<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        to_python(py, self.pool()?.counts())
    }

    fn announced_metrics(&mut self) -> PyResult<Vec<String>> {
        Ok(self.pool()?.metrics())
    }

    /// The sides of a match that each server announces: (server, sides).
    fn announced_sides<'py>(&mut self, py: Python<'py>) -> PyResult<Vec<(u64, Bound<'py, PyAny>)>> {
        let announced = self.pool()?.sides().into_iter();
        let fields =
            |(server, sides): (u64, &[AnnouncedSide])| Ok((server, to_python(py, &sides)?));
        announced.map(fields).collect()
    }

    /// What each server declares: (server, determinism, tolerance).
    fn determinism(&mut self) -> PyResult<Vec<Declared>> {
        let declared = self.pool()?.determinism().into_iter();
        let owned = |(server, kind, tolerance): (u64, Option<&str>, Option<f64>)| {
            (server, kind.map(str::to_owned), tolerance)
        };
        Ok(declared.map(owned).collect())
    }

    #[pyo3(signature = (architecture, genomes, seeds, on_progress=None, meanwhile=None, sample=None, only=None))]
    #[expect(
        clippy::needless_pass_by_value,
        clippy::too_many_arguments,
        reason = "pyo3 hands arguments over by value"
    )]
    fn evaluate<'py>(
        &mut self,
        py: Python<'py>,
        architecture: &Bound<'_, PyDict>,
        genomes: PyReadonlyArray2<'py, f32>,
        seeds: Vec<u64>,
        on_progress: Option<Py<PyAny>>,
        meanwhile: Option<Py<PyAny>>,
        sample: Option<PyRef<'_, PySample>>,
        only: Option<Vec<(usize, usize, Option<u64>)>>,
    ) -> PyResult<Evaluated<'py>> {
        let needed = self.metrics;
        let pool = self.pool()?;
        let mut work = work(architecture, &genomes, seeds)?;
        if let Some(sample) = sample {
            work = work.sampled(sample.0.clone()).map_err(input)?;
        }
        if let Some(only) = only {
            let repetition = |(candidate, episode, before)| Repetition {
                candidate,
                episode,
                before,
            };
            let only = only.into_iter().map(repetition).collect();
            work = work.only(only).map_err(input)?;
        }
        let shape = [work.candidates(), work.episodes(), needed];
        let total = work.len();
        // Each of the two callbacks may raise.
        let (mut in_meanwhile, mut in_progress): (Option<PyErr>, Option<PyErr>) = (None, None);
        let result = py.detach(|| {
            pool.evaluate(
                work,
                || {
                    meanwhile.as_ref().is_none_or(|call| {
                        let called = Python::attach(|py| call.call0(py).map(|_| ()));
                        called.map_err(|error| in_meanwhile = Some(error)).is_ok()
                    })
                },
                |done, waiting_for| {
                    let outcome = progress(on_progress.as_ref(), done, total, waiting_for);
                    outcome.map_err(|error| in_progress = Some(error)).is_ok()
                },
            )
        });
        in_meanwhile.map_or(Ok(()), Err)?;
        in_progress.map_or(Ok(()), Err)?;
        let results = result.map_err(|failed| error(&failed))?;
        let attempts = fields(py, &pool.take_journal())?;
        let warnings = fields(py, &pool.take_warnings())?;
        let (fitness, metrics) = arrays(py, results.fitness, results.metrics, shape)?;
        Ok((fitness, metrics, attempts, warnings))
    }

    #[pyo3(signature = (architecture, genomes, seeds, feed, on_progress=None, *, revised=false))]
    #[expect(
        clippy::too_many_arguments,
        clippy::needless_pass_by_value,
        reason = "pyo3 hands arguments over by value"
    )]
    fn stream(
        &mut self,
        py: Python<'_>,
        architecture: &Bound<'_, PyDict>,
        genomes: PyReadonlyArray2<'_, f32>,
        seeds: Vec<u64>,
        feed: Py<PyAny>,
        on_progress: Option<Py<PyAny>>,
        revised: bool,
    ) -> PyResult<()> {
        let needed = self.metrics;
        let pool = self.pool()?;
        let mut work = work(architecture, &genomes, seeds)?;
        if revised {
            work = work.revised();
        }
        let (episodes, columns) = (work.episodes(), genomes.shape()[1]);
        // Each of the two callbacks may raise.
        let (mut in_feed, mut in_progress): (Option<PyErr>, Option<PyErr>) = (None, None);
        let result = py.detach(|| {
            pool.stream(
                work,
                |settled, attempts, warnings| {
                    let called = Python::attach(|py| {
                        let shape = [settled.candidates.len(), episodes, needed];
                        let (fitness, metrics) =
                            arrays(py, settled.fitness, settled.metrics, shape)?;
                        let candidates = settled.candidates;
                        let attempts = fields(py, &attempts)?;
                        let warnings = fields(py, &warnings)?;
                        let arguments = (candidates, fitness, metrics, attempts, warnings);
                        let more = feed.call1(py, arguments)?;
                        further(py, &more, columns)
                    });
                    called.unwrap_or_else(|error| {
                        in_feed = Some(error);
                        None
                    })
                },
                |done, total, waiting_for| {
                    let outcome = progress(on_progress.as_ref(), done, total, waiting_for);
                    outcome.map_err(|error| in_progress = Some(error)).is_ok()
                },
            )
        });
        in_feed.map_or(Ok(()), Err)?;
        in_progress.map_or(Ok(()), Err)?;
        result.map_err(|failed| error(&failed))
    }

    /// Ends the producer that has it, if there is one; generations that wait are lost.
    pub fn take_back(&mut self, py: Python<'_>) {
        if let Some(borrower) = self.borrower.take()
            && let Some(pool) = py.detach(|| borrower.end())
        {
            self.pool = Some(pool);
            self.lent = false;
        }
    }

    fn close(&mut self, py: Python<'_>) {
        self.take_back(py);
        if let Some(pool) = self.pool.take() {
            py.detach(|| pool.close());
        }
    }
}

/// Says how it stands, and lets Ctrl-C through; raises what the callback raises.
fn progress(
    call: Option<&Py<PyAny>>,
    done: usize,
    total: usize,
    waiting_for: &str,
) -> PyResult<()> {
    Python::attach(|py| {
        py.check_signals()?;
        call.map_or(Ok(()), |call| {
            call.call1(py, (done, total, waiting_for)).map(|_| ())
        })
    })
}

/// Lines of a journal as dicts.
pub fn fields<'py>(py: Python<'py>, lines: &[impl Serialize]) -> PyResult<Vec<Fields<'py>>> {
    lines.iter().map(|line| to_python(py, line)).collect()
}

/// Further genomes from the return value of `feed`; `None` if it returned None.
fn further(py: Python<'_>, returned: &Py<PyAny>, columns: usize) -> PyResult<Option<Vec<f32>>> {
    if returned.is_none(py) {
        return Ok(None);
    }
    let genomes: PyReadonlyArray2<'_, f32> = returned.extract(py)?;
    if genomes.shape()[1] != columns {
        return Err(input(format!(
            "genomes: have {} weights each, but these controllers have {columns}",
            genomes.shape()[1]
        )));
    }
    Ok(Some(genomes.as_array().iter().copied().collect()))
}

impl PyPool {
    fn pool(&mut self) -> PyResult<&mut Pool> {
        let why = self.why_not();
        self.pool.as_mut().ok_or_else(|| input(why))
    }

    fn why_not(&self) -> &'static str {
        match self.lent {
            true => "the pool belongs to a producer until the producer is closed",
            false => "the pool is closed",
        }
    }

    /// Number of metrics that are needed of every episode.
    pub fn metrics(&self) -> usize {
        self.metrics
    }

    /// Hands it over to a producer.
    pub fn lend(&mut self) -> PyResult<Pool> {
        let why = self.why_not();
        let pool = self.pool.take().ok_or_else(|| input(why))?;
        self.lent = true;
        Ok(pool)
    }

    /// Names the thread that has it.
    pub fn lent_to(&mut self, borrower: Arc<Borrower>) {
        self.borrower = Some(borrower);
    }
}
