//! Stepwise evaluation without anything but its messages: as many servers, agents and bytes, no JSON, no simulation.
//!
//! Topics are flat, as in D6.1: the tool gets every server's messages on `--topic`, and every server gets all answers on
//! `--back` and picks its own by a tag of two bytes at the start of the payload.

use crate::{Failure, connection::Connection, options::Options, packet};
use std::io::{BufRead, BufReader, Write};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::Instant;

/// Bytes at the start of a payload that name the server it belongs to.
pub const TAG: usize = 2;

/// Plays `count` steps on each of `servers` processes and describes the rate as a JSON object.
pub fn run(options: &Options) -> Result<String, Failure> {
    let mut tool = Connection::open(options, "tool", Some(&options.topic))?;
    let mut servers = Servers::start(options)?;
    let answer = packet::publish(&options.back, &tagged(0, options.bytes_back), options.five);
    let place = answer.len() - options.bytes_back;
    let total = options.count * options.servers as u64 * options.agents as u64;
    let start = Instant::now();
    servers.begin()?;
    let (mut answers, mut answered) = (Vec::new(), 0);
    while answered < total {
        answers.clear();
        let heard = tool.publishes_each(|bytes| {
            if let Some(tag) = packet::payload(bytes, options.five).and_then(|all| all.get(..TAG)) {
                let from = answers.len() + place;
                answers.extend_from_slice(&answer);
                answers[from..from + TAG].copy_from_slice(tag);
            }
        })?;
        answered += heard.ok_or("no sensor message for 10 s: is the topic ours alone?")?;
        tool.write(&answers)?;
    }
    servers.end()?;
    let seconds = start.elapsed().as_secs_f64();
    Ok(format!(
        r#"{{"test":"swarm","bytes":{},"bytes_back":{},"servers":{},"agents":{},"count":{},"seconds":{seconds:.3},"agent_steps_per_s":{:.0},"messages_per_s":{:.0}}}"#,
        options.payload.len(),
        options.bytes_back,
        options.servers,
        options.agents,
        options.count,
        total as f64 / seconds,
        2.0 * total as f64 / seconds,
    ))
}

/// Plays one server, in a process of its own: begins when a line comes on standard input.
pub fn serve(options: &Options) -> Result<String, Failure> {
    let number = options.number;
    let mut connection = Connection::open(options, &format!("s{number}"), Some(&options.back))?;
    let reading = tagged(number, options.payload.len());
    let step = packet::publish(&options.topic, &reading, options.five).repeat(options.agents);
    println!("ready");
    std::io::stdin().read_line(&mut String::new())?;
    for _ in 0..options.count {
        connection.write(&step)?;
        let mut missing = options.agents;
        while missing > 0 {
            let mut ours = 0;
            let heard = connection.publishes_each(|bytes| {
                let payload = packet::payload(bytes, options.five).unwrap_or_default();
                ours += usize::from(payload.starts_with(&number.to_be_bytes()));
            })?;
            heard.ok_or("no actuator message for 10 s: is the topic ours alone?")?;
            missing = missing.saturating_sub(ours);
        }
    }
    Ok(String::new())
}

fn tagged(number: u16, bytes: usize) -> Vec<u8> {
    let mut payload = vec![b'x'; bytes];
    payload[..TAG].copy_from_slice(&number.to_be_bytes());
    payload
}

/// The server processes; those that are left when an error ends the test are killed.
struct Servers(Vec<Child>);

impl Servers {
    fn start(options: &Options) -> Result<Self, Failure> {
        let program = std::env::current_exe()?;
        let mut servers = Self(Vec::new());
        for number in 0..options.servers {
            let text = |number: usize| number.to_string();
            let child = Command::new(&program)
                .arg("swarm-server")
                .args(["--host", &options.host, "--port", &options.port.to_string()])
                .args(["--topic", &options.topic, "--back", &options.back])
                .args(["--bytes", &text(options.payload.len())])
                .args(["--count", &options.count.to_string()])
                .args(["--agents", &text(options.agents)])
                .args(["--number", &text(number)])
                .args(["--mqtt", if options.five { "5" } else { "3" }])
                .stdin(Stdio::piped())
                .stdout(Stdio::piped())
                .spawn()?;
            servers.0.push(child);
        }
        for child in &mut servers.0 {
            let mut line = String::new();
            if let Some(output) = &mut child.stdout {
                BufReader::new(output).read_line(&mut line)?;
            }
            if line.trim() != "ready" {
                return Err("a server of the swarm did not start".into());
            }
        }
        Ok(servers)
    }

    fn begin(&mut self) -> Result<(), Failure> {
        for child in &mut self.0 {
            if let Some(input) = &mut child.stdin {
                input.write_all(b"\n")?;
            }
        }
        Ok(())
    }

    fn end(&mut self) -> Result<(), Failure> {
        let ends: Result<Vec<ExitStatus>, _> = self.0.iter_mut().map(Child::wait).collect();
        if ends?.iter().all(ExitStatus::success) {
            Ok(())
        } else {
            Err("a server of the swarm failed".into())
        }
    }
}

impl Drop for Servers {
    fn drop(&mut self) {
        for child in &mut self.0 {
            if let Ok(None) = child.try_wait() {
                let _ = child.kill();
                let _ = child.wait();
            }
        }
    }
}
