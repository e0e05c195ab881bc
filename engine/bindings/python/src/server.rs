//! A built-in simulation as a simulation server.

use std::io::{IsTerminal, Write, stdout};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use pyo3::prelude::*;
use serde_json::{Value, json};
use swarmwright_worlds::{TextStyle, render};
use swarmwright_wrapper::{Notice, Options, Progress, Scene, ServeError, SimulationServer};

use crate::errors::{engine, input, unconnected};
use crate::modules::{WithModules, announced};
use crate::simulation::watched;
use crate::values::to_python;

/// Offers a simulation until interrupted.
#[pyfunction]
#[pyo3(signature = (simulation, broker, *, id, prefix="", step_timeout=None, display=true, alone=false, on_event=None, progress=None, modules=None))]
#[expect(clippy::too_many_arguments, reason = "keywords in Python")]
pub fn serve(
    py: Python<'_>,
    simulation: &Bound<'_, PyAny>,
    broker: &str,
    id: u64,
    prefix: &str,
    step_timeout: Option<f64>,
    display: bool,
    alone: bool,
    on_event: Option<Py<PyAny>>,
    progress: Option<PathBuf>,
    modules: Option<&Bound<'_, PyAny>>,
) -> PyResult<()> {
    let progress = progress.map(|path| Progress::open(&path)).transpose()?;
    let progress = progress.map(Arc::new);
    let mut simulation = watched(simulation, progress.clone())?;
    let mut options = Options::new(id, broker).map_err(input)?;
    if let Some(modules) = modules {
        simulation = Box::new(WithModules::new(simulation, modules, progress.clone())?);
        options.modules = announced(modules)?;
    }
    // Python has told, for all servers together.
    options.settings.clear_text_is_known = true;
    prefix.clone_into(&mut options.prefix);
    if let Some(timeout) = step_timeout {
        options.step_timeout = seconds("step_timeout", timeout)?;
    }
    options.alone = alone;
    options.progress = progress;
    options.on_frame = display.then(|| Box::new(draw) as Box<dyn FnMut(&Scene) + Send>);
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
                let called = Python::attach(|py| {
                    let event = to_python(py, &event(notice, id))?;
                    on_event.call1(py, (event,)).map(|_| ())
                });
                if let Err(error) = called {
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
fn seconds(name: &str, value: f64) -> PyResult<Duration> {
    Duration::try_from_secs_f64(value)
        .ok()
        .filter(|duration| !duration.is_zero())
        .ok_or_else(|| {
            input(format!(
                "{name}: {value} is not a duration; expected seconds, more than 0"
            ))
        })
}

fn event(notice: &Notice, server: u64) -> Value {
    match notice {
        Notice::Ready => json!({"event": "ready", "server": server}),
        Notice::Busy(tool) => json!({"event": "busy", "server": server, "tool": tool}),
        Notice::Warning(message) => {
            json!({"event": "warning", "server": server, "message": message})
        }
        Notice::Lost(reason) => json!({"event": "lost", "server": server, "message": reason}),
    }
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
    // The run goes on when the terminal is gone.
    let _ = writeln!(out, "{start}{text}").and_then(|()| out.flush());
}
