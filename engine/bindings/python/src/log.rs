//! The engine's log, as JSON lines.

use std::fs::{self, File};
use std::io::{self, Read, Seek, SeekFrom, Write, stderr};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::SystemTime;

use log::{LevelFilter, Log, Metadata, Record};
use pyo3::prelude::*;
use serde_json::json;

use crate::errors::input;

/// The output of the log; none before `log_to`.
static LINES: Lines = Lines(Mutex::new(None));

struct Lines(Mutex<Option<Sink>>);

enum Sink {
    Terminal,
    File(LogFile),
}

/// A file that several write to, line by line, and that is moved away when it is too long: by us, or by logrotate.
struct LogFile {
    path: PathBuf,
    file: File,
    /// Size in bytes at which the log is moved to `PATH.1`.
    most: Option<u64>,
    /// Lines that could not be written since the last that was.
    lost: u64,
}

impl LogFile {
    fn open(path: &Path) -> io::Result<File> {
        File::options().create(true).append(true).open(path)
    }

    /// Writes a line. The run goes on when that is not possible, as on a full disk; the user is told once.
    fn write(&mut self, line: &[u8]) {
        let written = if self.lost == 0 {
            self.append(line)
        } else {
            let mut lines = gap(self.lost);
            if self.ends_within_a_line() {
                lines.insert(0, b'\n');
            }
            lines.extend(line);
            self.append(&lines)
        };
        match written {
            Ok(()) => self.lost = 0,
            Err(error) => {
                self.lost += 1;
                if self.lost == 1 {
                    let path = self.path.display();
                    let _ = writeln!(
                        stderr(),
                        "warning: --log {path}: {error}; the log is incomplete"
                    );
                }
            }
        }
    }

    /// Whether a line was written in part.
    fn ends_within_a_line(&self) -> bool {
        let mut last = [0];
        let read = File::open(&self.path).and_then(|mut file| {
            file.seek(SeekFrom::End(-1))?;
            file.read_exact(&mut last)
        });
        read.is_ok() && last != *b"\n"
    }

    fn append(&mut self, line: &[u8]) -> io::Result<()> {
        let ours = self.file.metadata()?;
        let is_moved = fs::metadata(&self.path).is_ok_and(|metadata| metadata.ino() != ours.ino());
        let is_gone = !self.path.exists();
        let is_full = self
            .most
            .is_some_and(|most| ours.len() > 0 && ours.len() + line.len() as u64 > most);
        if is_full && !is_moved && !is_gone {
            let mut moved = self.path.clone().into_os_string();
            moved.push(".1");
            fs::rename(&self.path, moved)?;
        }
        if is_full || is_moved || is_gone {
            self.file = Self::open(&self.path)?;
        }
        self.file.write_all(line)
    }
}

impl Lines {
    fn write(&self, line: &[u8]) {
        let Ok(mut sink) = self.0.lock() else { return };
        match sink.as_mut() {
            None => {}
            // The reader may have gone: not a reason to end a run.
            Some(Sink::Terminal) => drop(stderr().write_all(line)),
            Some(Sink::File(file)) => file.write(line),
        }
    }
}

/// A line that says how many could not be written.
fn gap(lost: u64) -> Vec<u8> {
    let line = json!({
        "time": now(),
        "level": "warning",
        "event": "log_gap",
        "lines": lost,
    });
    format!("{line}\n").into_bytes()
}

fn now() -> String {
    humantime::format_rfc3339_millis(SystemTime::now()).to_string()
}

impl Log for Lines {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        // What libraries say of themselves is for those who debug them.
        metadata.target().starts_with("swarmwright")
    }

    fn log(&self, record: &Record<'_>) {
        if !self.enabled(record.metadata()) {
            return;
        }
        let level = record.level().as_str().to_ascii_lowercase();
        let level = if level == "warn" { "warning" } else { &level };
        let mut line = json!({
            "time": now(),
            "level": level,
            "event": "engine",
            "part": record.target().split("::").next().unwrap_or_default(),
            "message": record.args().to_string(),
        })
        .to_string();
        line.push('\n');
        self.write(line.as_bytes());
    }

    fn flush(&self) {}
}

/// Appends what the engine logs to a file, or writes it to standard error; a file that would be longer than `most` bytes is moved to
/// `PATH.1` first.
#[pyfunction]
#[pyo3(signature = (path, level="info", most=None))]
pub fn log_to(path: Option<PathBuf>, level: &str, most: Option<u64>) -> PyResult<()> {
    let level: LevelFilter = level
        .replace("warning", "warn")
        .parse()
        .map_err(|_| input(format!("level: {level:?} is unknown")))?;
    let sink = match path {
        Some(path) => Sink::File(LogFile {
            file: LogFile::open(&path)?,
            path,
            most,
            lost: 0,
        }),
        None => Sink::Terminal,
    };
    if let Ok(mut lines) = LINES.0.lock() {
        *lines = Some(sink);
    }
    // A second call finds it set already.
    let _ = log::set_logger(&LINES);
    log::set_max_level(level);
    Ok(())
}

/// Writes a line to where the engine's lines go.
#[pyfunction]
pub fn log_line(py: Python<'_>, line: &str) {
    let text = format!("{line}\n");
    py.detach(|| LINES.write(text.as_bytes()));
}
