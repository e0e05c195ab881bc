//! Schedules as readable text.

use std::fmt;

use super::{Disturbance, Memory, SECOND, Schedule, Time, Twin, What, Who};

/// Seconds.
struct Seconds(Time);

impl fmt::Display for Seconds {
    fn fmt(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
        write!(formatter, "{}.{:06} s", self.0 / SECOND, self.0 % SECOND)
    }
}

/// Parties have the numbers of their names in messages: servers those of their ids, from 1, unless they are twins; tools those
/// of their client ids, from 0.
impl fmt::Display for Who {
    fn fmt(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::Tool(index) => write!(formatter, "tool {index}"),
            Self::Server(index) => write!(formatter, "server {}", index + 1),
        }
    }
}

impl fmt::Display for Disturbance {
    fn fmt(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
        let lasts = Seconds(self.lasts);
        write!(formatter, "{:>13}  ", Seconds(self.at).to_string())?;
        match self.what {
            What::Cut(party) => write!(formatter, "the connection of {party} is cut"),
            What::Partition(party) => write!(formatter, "{party} is cut off for {lasts}"),
            What::Crash { server, power } => {
                let verb = if power { "loses its power" } else { "crashes" };
                write!(
                    formatter,
                    "{} {verb} and is back after {lasts}",
                    Who::Server(server)
                )
            }
            What::Leave(server) => {
                write!(
                    formatter,
                    "{} leaves and is back after {lasts}",
                    Who::Server(server)
                )
            }
            What::Freeze(party) => write!(formatter, "{party} is frozen for {lasts}"),
            What::Broker(memory) => {
                let memory = match memory {
                    Memory::Kept => "all",
                    Memory::Stale => "older",
                    Memory::Lost => "no",
                };
                write!(
                    formatter,
                    "the broker dies and is back after {lasts} with {memory} retained messages"
                )
            }
            What::Restart(tool) => {
                write!(
                    formatter,
                    "{} is killed and is back after {lasts}",
                    Who::Tool(tool)
                )
            }
            What::Interrupt(tool) => write!(
                formatter,
                "{} gives up its work and begins it again",
                Who::Tool(tool)
            ),
            What::Lose { party, percent } => {
                write!(
                    formatter,
                    "{percent} % of the messages of {party} are lost for {lasts}"
                )
            }
            What::Duplicate {
                party,
                percent,
                later,
            } => write!(
                formatter,
                "{percent} % of the messages of {party} come again up to {} later for {lasts}",
                Seconds(later)
            ),
            What::Reorder {
                party,
                percent,
                later,
            } => write!(
                formatter,
                "{percent} % of the messages of {party} are overtaken, up to {}, for {lasts}",
                Seconds(later)
            ),
            What::Cross {
                party,
                percent,
                later,
            } => write!(
                formatter,
                "{percent} % of the messages of {party} are overtaken by those on other topics, up to {}, for {lasts}",
                Seconds(later)
            ),
            What::Delay { party, by } => {
                write!(
                    formatter,
                    "all messages of {party} take {} longer for {lasts}",
                    Seconds(by)
                )
            }
            What::Break(server) => write!(
                formatter,
                "{} fails everything for {lasts}",
                Who::Server(server)
            ),
            What::Slow { server, times } => {
                write!(
                    formatter,
                    "{} computes {times} times as slowly for {lasts}",
                    Who::Server(server)
                )
            }
        }
    }
}

impl fmt::Display for Schedule {
    fn fmt(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
        for (index, server) in self.servers.iter().enumerate() {
            let plain = if server.plain {
                ", seven topics only".to_owned()
            } else if let Some(Twin { id, foreign }) = server.twin {
                let suffix = if foreign {
                    ", of another simulation"
                } else {
                    ""
                };
                format!(", with the id {id}{suffix}")
            } else {
                String::new()
            };
            writeln!(
                formatter,
                "{:>13}  {} joins: {} a step, patience {}{plain}",
                Seconds(server.joins).to_string(),
                Who::Server(index),
                Seconds(server.pace),
                Seconds(server.patience)
            )?;
        }
        for (index, tool) in self.tools.iter().enumerate() {
            writeln!(
                formatter,
                "{:>13}  {} joins: {}, {} attempts, time-out {}",
                Seconds(tool.joins).to_string(),
                Who::Tool(index),
                tool.mode,
                tool.attempts,
                Seconds(tool.step_timeout)
            )?;
            for work in &tool.works {
                writeln!(formatter, "               {work:?}")?;
            }
        }
        let mut sorted: Vec<&Disturbance> = self.disturbances.iter().collect();
        sorted.sort_by_key(|disturbance| disturbance.at);
        for disturbance in sorted {
            writeln!(formatter, "{disturbance}")?;
        }
        Ok(())
    }
}
