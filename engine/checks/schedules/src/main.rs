//! Runs schedules: `swarmwright-schedules [--first SEED] [--count N] [--jobs N]`, or one: `--schedule JSON [--log]`.

use std::process::ExitCode;
use std::time::Instant;

use swarmwright_schedules::{Schedule, check, draw, survey};

const USAGE: &str = "swarmwright-schedules [--first SEED] [--count N] [--jobs N] [--most FAILURES]
swarmwright-schedules (--seed SEED | --schedule JSON) [--log]";

struct Arguments {
    first: u64,
    count: u64,
    jobs: usize,
    most: usize,
    schedule: Option<Schedule>,
    log: bool,
}

fn arguments() -> Result<Arguments, String> {
    let mut arguments = Arguments {
        first: 1,
        count: 2000,
        jobs: 1,
        most: 3,
        schedule: None,
        log: false,
    };
    let mut rest = std::env::args().skip(1);
    while let Some(name) = rest.next() {
        let mut value = || rest.next().ok_or_else(|| format!("{name} needs a value"));
        let number = |text: String| {
            text.parse::<u64>()
                .map_err(|error| format!("{name} {text}: {error}"))
        };
        match name.as_str() {
            "--first" => arguments.first = number(value()?)?,
            "--count" => arguments.count = number(value()?)?,
            "--jobs" => arguments.jobs = usize::try_from(number(value()?)?).unwrap_or(1).max(1),
            "--most" => arguments.most = usize::try_from(number(value()?)?).unwrap_or(1).max(1),
            "--seed" => arguments.schedule = Some(draw(number(value()?)?)),
            "--schedule" => {
                arguments.schedule = Some(
                    serde_json::from_str(&value()?)
                        .map_err(|error| format!("--schedule: {error}"))?,
                );
            }
            "--log" => arguments.log = true,
            _ => return Err(format!("{name} is unknown")),
        }
    }
    Ok(arguments)
}

fn main() -> ExitCode {
    let arguments = match arguments() {
        Ok(arguments) => arguments,
        Err(error) => {
            eprintln!("{error}\n{USAGE}");
            return ExitCode::from(2);
        }
    };
    if let Some(schedule) = &arguments.schedule {
        let report = check(schedule, arguments.log);
        for line in &report.log {
            println!("{line}");
        }
        print!("{schedule}");
        println!(
            "{} events, {} scored, {} failed, fingerprint {:016x}",
            report.events, report.scored, report.failed, report.fingerprint
        );
        return match report.violation {
            Some(violation) => {
                println!("{violation}");
                ExitCode::FAILURE
            }
            None => ExitCode::SUCCESS,
        };
    }
    std::panic::set_hook(Box::new(|_| {}));
    let start = Instant::now();
    let summary = survey(
        arguments.first,
        arguments.count,
        arguments.jobs,
        arguments.most,
    );
    for failure in &summary.failures {
        println!("{failure}\n");
    }
    println!("{summary}, {:.1} s", start.elapsed().as_secs_f64());
    ExitCode::from(u8::from(!summary.failures.is_empty()))
}
