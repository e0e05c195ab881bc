//! What the engine logs, as JSON lines.

use std::fs::File;
use std::io::{Write, stderr};
use std::path::PathBuf;
use std::sync::Mutex;
use std::time::SystemTime;

use log::{LevelFilter, Log, Metadata, Record};
use pyo3::prelude::*;
use serde_json::json;

use crate::errors::input;

/// Where the lines go; none before `log_to`.
static LINES: Lines = Lines(Mutex::new(None));

struct Lines(Mutex<Option<Box<dyn Write + Send>>>);

impl Log for Lines {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        // What libraries say of themselves is for those who debug them.
        metadata.target().starts_with("swarmwright")
    }

    fn log(&self, record: &Record<'_>) {
        if !self.enabled(record.metadata()) {
            return;
        }
        let Ok(mut lines) = self.0.lock() else { return };
        let Some(lines) = lines.as_mut() else { return };
        let level = record.level().as_str().to_ascii_lowercase();
        let level = if level == "warn" { "warning" } else { &level };
        let mut line = json!({
            "time": humantime::format_rfc3339_millis(SystemTime::now()).to_string(),
            "level": level,
            "event": "engine",
            "part": record.target().split("::").next().unwrap_or_default(),
            "message": record.args().to_string(),
        })
        .to_string();
        line.push('\n');
        // A log that cannot be written is no reason to end a run.
        let _ = lines.write_all(line.as_bytes());
    }

    fn flush(&self) {}
}

/// Appends what the engine logs to a file, or writes it to standard error.
#[pyfunction]
#[pyo3(signature = (path, level="info"))]
pub fn log_to(path: Option<PathBuf>, level: &str) -> PyResult<()> {
    let level: LevelFilter = level
        .replace("warning", "warn")
        .parse()
        .map_err(|_| input(format!("level: {level:?} is unknown")))?;
    let lines: Box<dyn Write + Send> = match path {
        Some(path) => Box::new(File::options().create(true).append(true).open(path)?),
        None => Box::new(stderr()),
    };
    if let Ok(mut place) = LINES.0.lock() {
        *place = Some(lines);
    }
    // A second call finds it set already.
    let _ = log::set_logger(&LINES);
    log::set_max_level(level);
    Ok(())
}
