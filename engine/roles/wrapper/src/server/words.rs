//! Replacement texts: reasons of lost connections, and refusals in place of oversized answers.

use std::collections::BTreeMap;

use swarmwright_protocol::{
    BatchSensors, Evaluated, F32s, F64s, Refusal, RefusalKind, ToTool, U32s,
};

/// Returns why the connection ended, with the size of the last packet if it may be the cause.
pub(super) fn lost(reason: String, unread: usize) -> String {
    match unread {
        0 => reason,
        bytes => format!(
            "{reason}, right after a packet of {bytes} bytes was sent; the broker may not accept packets of that size"
        ),
    }
}

/// Returns the refusal that replaces an answer too large for the broker.
pub(super) fn refusal(answer: &[u8], reason: String) -> Vec<u8> {
    let error = Some(Refusal {
        kind: RefusalKind::Failed,
        reason,
    });
    match ToTool::decode(answer) {
        Ok(ToTool::Evaluated(answer)) => ToTool::Evaluated(Evaluated {
            fitness: F64s::default(),
            metrics: BTreeMap::new(),
            failed: Vec::new(),
            error,
            ..answer
        })
        .encode(),
        Ok(ToTool::Sensors(answer)) => ToTool::Sensors(BatchSensors {
            episodes: U32s::default(),
            agents: U32s::default(),
            sensors: F32s::default(),
            ended: U32s::default(),
            fitness: F64s::default(),
            metrics: BTreeMap::new(),
            failed: Vec::new(),
            error,
            ..answer
        })
        .encode(),
        // A reason is short; only a broker with a tiny limit refuses it.
        Ok(ToTool::Failed(_) | ToTool::Scene(_)) | Err(_) => Vec::new(),
    }
}

/// Returns whether an answer is a scene; the episode ends if a scene cannot be sent.
pub(super) fn is_scene(answer: &[u8]) -> bool {
    matches!(ToTool::decode(answer), Ok(ToTool::Scene(_)))
}
