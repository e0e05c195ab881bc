//! Servers and tools on a broker, for `swarmwright servers`.

use std::time::{Duration, Instant};

use pyo3::prelude::*;
use serde_json::{Value, json};
use swarmwright_pool::{News, PoolError, Watcher, forget_servers, list_servers};
use swarmwright_protocol::{Presence, Status};

use crate::account::{Account, settings};
use crate::errors::{engine, input};
use crate::values::to_python;

/// Interval of checks for Ctrl-C.
const ASK: Duration = Duration::from_millis(100);

/// Receives what servers and tools on a broker announce.
#[pyclass(name = "Watcher", module = "swarmwright._engine")]
pub struct PyWatcher {
    /// None once it is closed.
    watcher: Option<Watcher>,
}

fn error(error: &PoolError) -> PyErr {
    match error {
        PoolError::Settings(_) | PoolError::Topic(_) => input(error),
        _ => engine(error),
    }
}

#[pymethods]
impl PyWatcher {
    #[new]
    #[pyo3(signature = (broker, *, prefix="", account=None))]
    fn new(py: Python<'_>, broker: &str, prefix: &str, account: Option<Account>) -> PyResult<Self> {
        let settings = settings(broker, account)?;
        py.detach(|| Watcher::connect(settings, prefix, true))
            .map(|watcher| Self {
                watcher: Some(watcher),
            })
            .map_err(|failed| error(&failed))
    }

    fn poll<'py>(&mut self, py: Python<'py>, seconds: f64) -> PyResult<Bound<'py, PyAny>> {
        let wait = Duration::try_from_secs_f64(seconds)
            .map_err(|failed| input(format!("seconds: {failed}")))?;
        let watcher = self
            .watcher
            .as_mut()
            .ok_or_else(|| input("the watcher is closed"))?;
        let deadline = Instant::now() + wait;
        loop {
            let until = deadline.min(Instant::now() + ASK);
            let news = py.detach(|| watcher.poll(until));
            py.check_signals()?;
            if !news.is_empty() || until >= deadline {
                let events: Value = news.iter().map(event).collect();
                return to_python(py, &events);
            }
        }
    }

    fn close(&mut self, py: Python<'_>) {
        if let Some(watcher) = self.watcher.take() {
            py.detach(|| watcher.close());
        }
    }
}

fn event(news: &News) -> Value {
    match news {
        News::Presence(presence) => json!({"presence": server(presence)}),
        News::Left(id) => json!({"left": id}),
        News::Status(token, status) => json!({"status": tool(status), "token": token}),
        News::Broker(Ok(())) => json!({"broker": "back"}),
        News::Broker(Err(reason)) => json!({"broker": "lost", "reason": reason}),
    }
}

fn server(presence: &Presence) -> Value {
    let announced = presence.capabilities.swarmwright.as_ref();
    json!({
        "server": presence.server,
        "state": presence.state,
        "simulations": presence.simulations,
        "capabilities": presence.capabilities.to_value(),
        "tool": presence.tool,
        "since": presence.since,
        "host": announced.and_then(|announced| announced.host.clone()),
        "pid": announced.and_then(|announced| announced.pid),
    })
}

/// A status with what it waits for in words, too.
fn tool(status: &Status) -> Value {
    let mut value = json!(status);
    if let Some(entries) = value["waiting_for"].as_array_mut() {
        for (entry, waiting) in entries.iter_mut().zip(&status.waiting_for) {
            entry["words"] = waiting.to_string().into();
        }
    }
    value
}

/// The servers on a broker.
#[pyfunction]
#[pyo3(signature = (broker, *, prefix="", wait=1.0))]
pub fn servers<'py>(
    py: Python<'py>,
    broker: &str,
    prefix: &str,
    wait: f64,
) -> PyResult<Bound<'py, PyAny>> {
    let settings = settings(broker, None)?;
    let wait = duration(wait)?;
    let answers = py
        .detach(|| list_servers(settings, prefix, wait))
        .map_err(|failed| error(&failed))?;
    let servers: Value = answers.iter().map(server).collect();
    to_python(py, &servers)
}

/// Removes the presence of servers from a broker.
#[pyfunction]
#[pyo3(signature = (broker, servers, *, prefix="", wait=1.0))]
pub fn forget(
    py: Python<'_>,
    broker: &str,
    servers: Vec<u64>,
    prefix: &str,
    wait: f64,
) -> PyResult<Vec<u64>> {
    let settings = settings(broker, None)?;
    let wait = duration(wait)?;
    py.detach(|| forget_servers(settings, prefix, &servers, wait))
        .map_err(|failed| error(&failed))
}

fn duration(wait: f64) -> PyResult<Duration> {
    Duration::try_from_secs_f64(wait).map_err(|failed| input(format!("wait: {failed}")))
}
