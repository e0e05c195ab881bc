//! The optimization tool's side of the broker.

use numpy::{PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use serde_json::{Value, json};
use swarmwright_mqtt::Settings;
use swarmwright_pool::{About, Attempt, Demand, Faults, Options, Pool, PoolError, Report};
use swarmwright_protocol::Requirements;

use crate::errors::{engine, input, object, unconnected};
use crate::genomes::work;
use crate::results::{Fitness, Metrics, arrays};
use crate::server::seconds;
use crate::supervision::PySupervision;

/// Finds servers and runs episodes on them.
#[pyclass(name = "Pool", module = "swarmwright._engine")]
pub struct PyPool {
    /// None once it is closed.
    pool: Option<Pool>,
    /// Number of metrics that are needed of every episode.
    metrics: usize,
}

fn error(error: &PoolError) -> PyErr {
    match error {
        PoolError::Settings(_) | PoolError::Topic(_) | PoolError::NoSizes | PoolError::Work(_) => {
            input(error)
        }
        PoolError::Connect(error) => unconnected(error),
        _ => engine(error),
    }
}

#[pymethods]
impl PyPool {
    #[new]
    #[pyo3(signature = (broker, *, simulation, parameters, requirements, sensors=None, actuators=None, prefix="", tool="",
        mode="auto", metrics=None, visual=false, discovery_timeout=10.0, step_timeout=60.0, episode_timeout=86_400.0, least_timeout=1.0,
        attempts=3, quarantine=3, backup=true, audit=0.0, largest=None, alone=false))]
    #[expect(clippy::too_many_arguments, reason = "keywords in Python")]
    fn new(
        py: Python<'_>,
        broker: &str,
        simulation: String,
        parameters: &str,
        requirements: &str,
        sensors: Option<usize>,
        actuators: Option<usize>,
        prefix: &str,
        tool: &str,
        mode: &str,
        metrics: Option<Vec<String>>,
        visual: bool,
        discovery_timeout: f64,
        step_timeout: f64,
        episode_timeout: f64,
        least_timeout: f64,
        attempts: u32,
        quarantine: u32,
        backup: bool,
        audit: f64,
        largest: Option<usize>,
        alone: bool,
    ) -> PyResult<Self> {
        let requirements = Requirements::decode(requirements.as_bytes())
            .map_err(|error| input(format!("requirements: {error}")))?;
        let needed = metrics.unwrap_or_default();
        let metrics = needed.len();
        let options = Options {
            settings: Settings::from_environment(broker).map_err(input)?,
            prefix: prefix.to_owned(),
            tool: tool.to_owned(),
            demand: Demand {
                simulation,
                requirements,
                sensors,
                actuators,
                mode: mode.parse().map_err(input)?,
                kind: None,
                metrics: needed,
            },
            parameters: object("parameters", parameters)?,
            visual,
            discovery_timeout: seconds("discovery_timeout", discovery_timeout)?,
            step_timeout: seconds("step_timeout", step_timeout)?,
            faults: Faults {
                attempts: attempts.max(1),
                quarantine: quarantine.max(1),
                backup,
                audit,
                least: seconds("least_timeout", least_timeout)?,
                episode: seconds("episode_timeout", episode_timeout)?,
            },
            largest: largest.unwrap_or(usize::MAX),
            alone,
        };
        py.detach(|| Pool::connect(options))
            .map(|pool| Self {
                pool: Some(pool),
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

    /// Has somebody told what happens, a JSON object each; what the callback raises is dropped.
    #[pyo3(signature = (on_report, *, warnings_only=false))]
    fn listen(&mut self, on_report: Py<PyAny>, warnings_only: bool) -> PyResult<()> {
        self.pool()?.listen(Box::new(move |told: &Report<'_>| {
            let is_warning = matches!(
                told,
                Report::Warning(_) | Report::BrokerLost(_) | Report::BrokerBack
            );
            if warnings_only && !is_warning {
                return;
            }
            let text = report(told).to_string();
            Python::attach(|py| {
                if let Err(error) = on_report.call1(py, (text,)) {
                    error.write_unraisable(py, None);
                }
            });
        }));
        Ok(())
    }

    #[pyo3(signature = (run=None, generation=None, generations=None, evaluations=None))]
    fn about(
        &mut self,
        run: Option<String>,
        generation: Option<u64>,
        generations: Option<u64>,
        evaluations: Option<(u64, u64)>,
    ) -> PyResult<()> {
        self.pool()?.set_about(About {
            run,
            generation,
            generations,
            evaluations,
        });
        Ok(())
    }

    /// Incidents so far, by name.
    fn counts(&mut self) -> PyResult<String> {
        Ok(json!(self.pool()?.counts()).to_string())
    }

    fn announced_metrics(&mut self) -> PyResult<Vec<String>> {
        Ok(self.pool()?.metrics())
    }

    #[pyo3(signature = (architecture, genomes, seeds, on_progress=None))]
    #[expect(
        clippy::needless_pass_by_value,
        reason = "pyo3 hands arguments over by value"
    )]
    fn evaluate<'py>(
        &mut self,
        py: Python<'py>,
        architecture: &str,
        genomes: PyReadonlyArray2<'py, f32>,
        seeds: Vec<u64>,
        on_progress: Option<Py<PyAny>>,
    ) -> PyResult<(Fitness<'py>, Metrics<'py>, String)> {
        let needed = self.metrics;
        let pool = self.pool()?;
        let work = work(architecture, &genomes, seeds)?;
        let shape = [work.candidates(), work.episodes(), needed];
        let total = work.len();
        let mut raised: Option<PyErr> = None;
        let result = py.detach(|| {
            pool.evaluate(work, |done, waiting_for| {
                let told = progress(on_progress.as_ref(), done, total, waiting_for);
                told.map_err(|error| raised = Some(error)).is_ok()
            })
        });
        raised.map_or(Ok(()), Err)?;
        let results = result.map_err(|failed| error(&failed))?;
        let journal = lines(pool.take_warnings(), pool.take_journal());
        let (fitness, metrics) = arrays(py, results.fitness, results.metrics, shape)?;
        Ok((fitness, metrics, journal))
    }

    #[pyo3(signature = (architecture, genomes, seeds, feed, on_progress=None))]
    #[expect(
        clippy::needless_pass_by_value,
        reason = "pyo3 hands arguments over by value"
    )]
    fn stream(
        &mut self,
        py: Python<'_>,
        architecture: &str,
        genomes: PyReadonlyArray2<'_, f32>,
        seeds: Vec<u64>,
        feed: Py<PyAny>,
        on_progress: Option<Py<PyAny>>,
    ) -> PyResult<()> {
        let needed = self.metrics;
        let pool = self.pool()?;
        let work = work(architecture, &genomes, seeds)?;
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
                        let journal = lines(warnings, attempts);
                        let more =
                            feed.call1(py, (settled.candidates, fitness, metrics, journal))?;
                        further(py, &more, columns)
                    });
                    called.unwrap_or_else(|error| {
                        in_feed = Some(error);
                        None
                    })
                },
                |done, total, waiting_for| {
                    let told = progress(on_progress.as_ref(), done, total, waiting_for);
                    told.map_err(|error| in_progress = Some(error)).is_ok()
                },
            )
        });
        in_feed.map_or(Ok(()), Err)?;
        in_progress.map_or(Ok(()), Err)?;
        result.map_err(|failed| error(&failed))
    }

    fn close(&mut self, py: Python<'_>) {
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

/// Something that happened, as JSON.
fn report(told: &Report<'_>) -> Value {
    match told {
        Report::Server(server, state) => {
            let state = state.map_or(json!("left"), |state| json!(state));
            json!({"event": "server", "server": server, "state": state})
        }
        Report::Attempt(attempt) => {
            let mut value = json!(attempt);
            value["event"] = "attempt".into();
            value
        }
        Report::Benched {
            server,
            failures,
            reason,
            seconds,
        } => {
            json!({"event": "benched", "server": server, "failures": failures, "reason": reason, "seconds": seconds})
        }
        Report::Warning(text) => json!({"event": "warning", "message": text}),
        Report::BrokerLost(reason) => json!({"event": "broker_lost", "reason": reason}),
        Report::BrokerBack => json!({"event": "broker_back"}),
        Report::Status(status, traffic, counts) => {
            json!({"event": "status", "status": status, "counts": counts, "traffic": {
            "sent_bytes": traffic.sent_bytes, "received_bytes": traffic.received_bytes,
            "sent_messages": traffic.sent_messages, "received_messages": traffic.received_messages}})
        }
    }
}

/// Warnings and attempts as JSON, a line each.
fn lines(warnings: Vec<String>, attempts: Vec<Attempt>) -> String {
    let warnings = warnings
        .into_iter()
        .map(|warning| json!({"warning": warning}).to_string());
    let attempts = attempts
        .into_iter()
        .map(|attempt| json!(attempt).to_string());
    warnings.chain(attempts).collect::<Vec<_>>().join("\n")
}

/// Further genomes from what `feed` returned; none when it returned None.
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
        self.pool
            .as_mut()
            .ok_or_else(|| input("the pool is closed"))
    }
}
