//! Messages between the pool and the supervisor of its servers' processes.

use pyo3::prelude::*;
use swarmwright_pool::{At, Ending, Supervision};

/// For one pool; of any thread.
#[pyclass(name = "Supervision", module = "swarmwright._engine", frozen)]
pub struct PySupervision(pub Supervision);

#[pymethods]
impl PySupervision {
    /// A process has ended; `at`: request, first candidate, candidates, episode or None.
    #[pyo3(signature = (server, pid, reason, *, stack=None, outside=false, at=None))]
    fn ended(
        &self,
        server: u64,
        pid: u64,
        reason: String,
        stack: Option<String>,
        outside: bool,
        at: Option<(u64, usize, usize, Option<usize>)>,
    ) {
        self.0.ended(Ending {
            server,
            pid,
            reason,
            stack,
            outside,
            at: at.map(|(request, first, candidates, episode)| At {
                request,
                first,
                candidates,
                episode,
            }),
        });
    }

    fn is_alive(&self, server: u64) {
        self.0.is_alive(server);
    }

    fn starting(&self, servers: usize) {
        self.0.starting(servers);
    }

    fn take_overdue(&self) -> Vec<u64> {
        self.0.take_overdue()
    }

    fn place(&self, request: u64) -> Option<(usize, usize, Option<u64>, Option<String>)> {
        let position = self.0.place(request)?;
        let purpose = position.purpose.as_deref().map(str::to_owned);
        Some((
            position.candidate,
            position.episode,
            position.generation,
            purpose,
        ))
    }
}
