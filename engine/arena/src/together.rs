//! What one controller gets from robots of several kinds, and gives them.

use super::robot::{LedColor, Output, Robot};
use super::team::Group;

/// The numbers of a controller for all kinds.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Row {
    /// Names of what it gets; where kinds have several things in one place, all their names.
    pub sensors: Vec<String>,
    /// Names of what it gives.
    pub actuators: Vec<String>,
    /// By kind: where the numbers for its LEDs begin.
    pub leds: Vec<usize>,
    /// Where the number for grippers is, where a kind has one.
    pub gripper: Option<usize>,
}

/// Numbers that some kinds have.
struct Column<T> {
    of: T,
    names: Vec<String>,
    directions: Vec<f32>,
    /// Which kinds.
    owners: Vec<usize>,
}

/// Puts the numbers of kinds beside each other. Kinds that have as many share them, number by number; else what is of the
/// same kind, with the same names and directions, is shared, and the other kinds get what is there where there is nothing.
pub(super) fn arrange(groups: &mut [Group]) -> Row {
    let same = |count: fn(&Robot) -> usize| {
        let first = count(&groups[0].robot);
        groups.iter().all(|group| count(&group.robot) == first)
    };
    let (same_sensors, same_leds) = (same(Robot::sensors), same(|robot| robot.leds.len()));
    let sensors = if same_sensors {
        beside(groups, Robot::sensor_names)
    } else {
        let columns = columns(groups, |robot| {
            let outputs = robot.outputs.iter();
            outputs
                .map(|output| (*output, robot.names(*output), robot.directions(*output)))
                .collect()
        });
        for (index, group) in groups.iter_mut().enumerate() {
            group.robot.outputs = columns.iter().map(|column| output(column, index)).collect();
        }
        named(&columns, groups)
    };
    let drive = groups[0].robot.drive.actuators().len();
    let mut actuators = beside(groups, |robot| {
        let drive = robot.drive.actuators().iter();
        drive.map(|name| (*name).to_owned()).collect()
    });
    let leds = if same_leds {
        actuators.extend(beside(groups, Robot::led_names));
        vec![drive; groups.len()]
    } else {
        let columns = columns(groups, |robot: &Robot| {
            let leds = (robot.leds.clone(), robot.led_names(), Vec::new());
            Vec::from_iter((!robot.leds.is_empty()).then_some(leds))
        });
        actuators.extend(named(&columns, groups));
        places(&columns, drive, groups.len())
    };
    let grips = groups.iter().any(|group| group.robot.gripper.is_some());
    let gripper = grips.then_some(actuators.len());
    actuators.extend(grips.then(|| "gripper".to_owned()));
    actuators.extend(beside(groups, Robot::message_names));
    Row {
        sensors,
        actuators,
        leds,
        gripper,
    }
}

/// What a kind has in a column.
fn output(column: &Column<Output>, kind: usize) -> Output {
    if column.owners.contains(&kind) {
        column.of
    } else {
        // At most 128 readings.
        Output::Absent(column.names.len() as u8, column.of.neutral())
    }
}

/// Where the numbers of each kind begin, after those of the drive.
fn places(columns: &[Column<Vec<LedColor>>], drive: usize, kinds: usize) -> Vec<usize> {
    let mut leds = vec![drive; kinds];
    let mut at = drive;
    for column in columns {
        for owner in &column.owners {
            leds[*owner] = at;
        }
        at += column.names.len();
    }
    leds
}

/// The columns of all kinds, in the order in which they have them.
fn columns<T: PartialEq>(
    groups: &[Group],
    of: impl Fn(&Robot) -> Vec<(T, Vec<String>, Vec<f32>)>,
) -> Vec<Column<T>> {
    let mut columns: Vec<Column<T>> = Vec::new();
    for (index, group) in groups.iter().enumerate() {
        for (what, names, directions) in of(&group.robot) {
            let known = columns.iter_mut().find(|column| {
                column.of == what && column.names == names && column.directions == directions
            });
            match known {
                Some(column) => column.owners.push(index),
                None => columns.push(Column {
                    of: what,
                    names,
                    directions,
                    owners: vec![index],
                }),
            }
        }
    }
    columns
}

/// The names of numbers beside each other; those that are there twice begin with the names of the kinds that have them.
fn named<T>(columns: &[Column<T>], groups: &[Group]) -> Vec<String> {
    let mut names = Vec::new();
    for (index, column) in columns.iter().enumerate() {
        let twice = columns.iter().enumerate().any(|(other, known)| {
            other != index && known.names.iter().any(|name| column.names.contains(name))
        });
        let kinds = column.owners.iter().map(|owner| &groups[*owner].name[..]);
        let kinds = kinds.collect::<Vec<_>>().join(" and ");
        let names_of = column.names.iter().map(|name| {
            if twice {
                format!("{kinds} {name}")
            } else {
                name.clone()
            }
        });
        names.extend(names_of);
    }
    names
}

/// The names of as many numbers of each kind, number by number; where kinds differ, all their names.
fn beside(groups: &[Group], of: impl Fn(&Robot) -> Vec<String>) -> Vec<String> {
    let mut names: Vec<Vec<String>> = Vec::new();
    for group in groups {
        for (index, name) in of(&group.robot).into_iter().enumerate() {
            match names.get_mut(index) {
                None => names.push(vec![name]),
                Some(known) if !known.contains(&name) => known.push(name),
                Some(_) => {}
            }
        }
    }
    names.into_iter().map(|same| same.join(" or ")).collect()
}
