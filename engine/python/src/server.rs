//! A built-in simulation as a simulation server.

use std::io::{IsTerminal, Write, stdout};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use pyo3::prelude::*;
use serde_json::json;
use swarmwright_mqtt::Settings;
use swarmwright_worlds::{TextStyle, render};
use swarmwright_wrapper::{Notice, Options, Progress, Scene, ServeError, SimulationServer};

use crate::errors::{engine, input, unconnected};
use crate::simulation::watched;

/// Offers a simulation until interrupted.
#[pyfunction]
#[pyo3(signature = (simulation, broker, *, id, prefix="", step_timeout=60.0, display=true, alone=false, on_event=None, progress=None))]
#[expect(clippy::too_many_arguments, reason = "keywords in Python")]
pub fn serve(
    py: Python<'_>,
    simulation: &Bound<'_, PyAny>,
    broker: &str,
    id: u64,
    prefix: &str,
    step_timeout: f64,
    display: bool,
    alone: bool,
    on_event: Option<Py<PyAny>>,
    progress: Option<PathBuf>,
) -> PyResult<()> {
    let progress = progress.map(|path| Progress::open(&path)).transpose()?;
    let progress = progress.map(Arc::new);
    let simulation = watched(simulation, progress.clone())?;
    let mut settings = Settings::from_environment(broker).map_err(input)?;
    // Python has told, for all servers together.
    settings.clear_text_is_known = true;
    let options = Options {
        id,
        settings,
        prefix: prefix.to_owned(),
        step_timeout: seconds("step_timeout", step_timeout)?,
        threads: 1,
        alone,
        progress,
        on_frame: display.then(|| Box::new(draw) as Box<dyn FnMut(&Scene) + Send>),
    };
    let mut failure: Option<PyErr> = None;
    py.detach(|| {
        let server =
            SimulationServer::connect(vec![simulation], options).map_err(|error| match &error {
                ServeError::Connect(error) => unconnected(error),
                _ => engine(error),
            })?;
        // Both callbacks run in turn on this thread; the cell lets both report the first error.
        let failed = std::cell::RefCell::new(&mut failure);
        let served = server.run(
            |notice| {
                let Some(on_event) = &on_event else { return };
                if let Err(error) =
                    Python::attach(|py| on_event.call1(py, (event(notice, id),)).map(|_| ()))
                {
                    **failed.borrow_mut() = Some(error);
                }
            },
            || {
                if failed.borrow().is_some() {
                    return false;
                }
                match Python::attach(|py| py.check_signals()) {
                    Ok(()) => true,
                    Err(error) => {
                        **failed.borrow_mut() = Some(error);
                        false
                    }
                }
            },
        );
        served.map_err(engine)
    })?;
    failure.map_or(Ok(()), Err)
}

/// A duration from Python, in seconds.
pub fn seconds(name: &str, value: f64) -> PyResult<Duration> {
    Duration::try_from_secs_f64(value)
        .ok()
        .filter(|duration| !duration.is_zero())
        .ok_or_else(|| {
            input(format!(
                "{name}: {value} is no duration; expected seconds, more than 0"
            ))
        })
}

fn event(notice: &Notice, server: u64) -> String {
    match notice {
        Notice::Ready => json!({"event": "ready", "server": server}),
        Notice::Busy(tool) => json!({"event": "busy", "server": server, "tool": tool}),
        Notice::Warning(message) => {
            json!({"event": "warning", "server": server, "message": message})
        }
        Notice::Lost(reason) => json!({"event": "lost", "server": server, "message": reason}),
    }
    .to_string()
}

/// Draws a frame in this process's terminal, over the one before; or a frame after the other where there is no terminal.
fn draw(scene: &Scene) {
    let mut out = stdout().lock();
    let terminal = out.is_terminal();
    let (columns, rows) = terminal_size::terminal_size().map_or((80, 24), |(width, height)| {
        (
            usize::from(width.0),
            usize::from(height.0).saturating_sub(1),
        )
    });
    let utf8 = ["LC_ALL", "LC_CTYPE", "LANG"]
        .iter()
        .find_map(|name| std::env::var(name).ok().filter(|value| !value.is_empty()))
        .is_some_and(|locale| {
            locale
                .to_ascii_lowercase()
                .replace('-', "")
                .contains("utf8")
        });
    let color = terminal && std::env::var_os("NO_COLOR").is_none();
    let text = render(
        scene,
        TextStyle {
            columns,
            rows,
            color,
            unicode: utf8,
        },
    )
    .join("\n");
    let start = match (terminal, scene.step) {
        (true, 0) => "\x1b[2J\x1b[H",
        (true, _) => "\x1b[H\x1b[J",
        (false, _) => "",
    };
    // A terminal that is gone is no reason to end the run.
    let _ = writeln!(out, "{start}{text}").and_then(|()| out.flush());
}
