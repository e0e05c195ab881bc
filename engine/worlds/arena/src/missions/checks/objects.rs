//! Objects that robots can push, as described in a mission.

use serde_json::Value;
use swarmwright_simulation::ParameterError;
use swarmwright_simulation::parameters::wrong;

use super::limits::{coordinates, length};
use super::start::start;
use crate::missions::text::ObjectText;
use crate::mistakes::{Mistakes, items};
use crate::place::{Form, Kind, MOST_OBJECTS, Place, Places, Pose};
use crate::start::objects::{free, overlap};

/// Adds the objects to a place that already has its obstacles and, if valid, its walls.
pub(super) fn add(texts: Option<&Value>, layout: &mut Place, mistakes: &mut Mistakes) {
    let mut fixed: Vec<(String, Form, Pose)> = Vec::new();
    for (at, text) in items(texts, "mission.objects", mistakes) {
        mistakes.take(add_one(&at, &text, &mut fixed, layout));
    }
    let count: usize = layout.objects.iter().map(Kind::count).sum();
    if count > MOST_OBJECTS {
        let reason = format!("{count} objects found, at most {MOST_OBJECTS} are possible");
        mistakes.add(wrong("mission.objects", reason));
    }
}

fn add_one(
    at: &str,
    text: &ObjectText,
    fixed: &mut Vec<(String, Form, Pose)>,
    layout: &mut Place,
) -> Result<(), ParameterError> {
    if text.name.is_empty() {
        return Err(wrong(&format!("{at}.name"), "must not be empty"));
    }
    if layout.objects.iter().any(|kind| kind.name == text.name) {
        return Err(wrong(
            &format!("{at}.name"),
            format!(
                "other objects are already named {:?}; choose another name",
                text.name
            ),
        ));
    }
    let form = form(at, text)?;
    length(&format!("{at}.height"), text.height)?;
    within(&format!("{at}.mass"), text.mass, [0.001, 1000.0])?;
    within(&format!("{at}.friction"), text.friction, [0.001, 10.0])?;
    let places = places(at, text, layout)?;
    if let Places::Fixed(pose) = places {
        if !layout.outline.is_empty() && !free((form, pose), layout) {
            let reason = "must be inside the walls and outside obstacles";
            return Err(wrong(at, reason));
        }
        let other = fixed
            .iter()
            .find(|(_, other, their)| overlap((form, pose), (*other, *their)));
        if let Some((name, ..)) = other {
            let reason = format!("{:?} and {name:?} overlap", text.name);
            return Err(wrong(at, reason));
        }
        fixed.push((text.name.clone(), form, pose));
    }
    layout.objects.push(Kind {
        name: text.name.clone(),
        form,
        height: text.height,
        mass: text.mass,
        friction: text.friction,
        color: text.color,
        places,
    });
    Ok(())
}

/// Minimum extent, metres; smaller objects could pass through others.
const LEAST: f32 = 0.01;

fn form(at: &str, text: &ObjectText) -> Result<Form, ParameterError> {
    match (text.radius, text.size) {
        (Some(radius), None) => {
            within(&format!("{at}.radius"), radius, [LEAST, 100.0])?;
            Ok(Form::Disc { radius })
        }
        (None, Some(size)) => {
            for (axis, size) in size.into_iter().enumerate() {
                within(&format!("{at}.size[{axis}]"), size, [LEAST, 100.0])?;
            }
            Ok(Form::Box {
                half: size.map(|size| size / 2.0),
            })
        }
        _ => Err(wrong(
            at,
            "expected radius (a disc), or size: [length, width] (a box)",
        )),
    }
}

fn places(at: &str, text: &ObjectText, layout: &Place) -> Result<Places, ParameterError> {
    match (text.center, &text.start) {
        (Some(center), None) => {
            if let Some(count) = text.count.filter(|count| *count != 1) {
                return Err(wrong(
                    &format!("{at}.count"),
                    format!(
                        "{count} found, but only one object has room at a center; use start for several"
                    ),
                ));
            }
            coordinates(&format!("{at}.center"), &center)?;
            let angle = text.angle.unwrap_or(0.0);
            coordinates(&format!("{at}.angle"), &[angle])?;
            let turns = f64::from(angle) / 180.0;
            let heading = (turns - 2.0 * (turns / 2.0).round()) as f32;
            Ok(Places::Fixed(Pose {
                at: center,
                heading,
            }))
        }
        (None, Some(region)) => {
            if text.angle.is_some() {
                return Err(wrong(
                    &format!("{at}.angle"),
                    "with start the angle is random, too; leave it out or use center",
                ));
            }
            let count = text.count.unwrap_or(1);
            if !(1..=MOST_OBJECTS).contains(&count) {
                return Err(wrong(
                    &format!("{at}.count"),
                    format!("{count} found, expected 1 to {MOST_OBJECTS}"),
                ));
            }
            let start = start(&format!("{at}.start"), region, layout)?;
            Ok(Places::Drawn(start, count))
        }
        _ => Err(wrong(
            at,
            "expected center, its position, or start, a region for random positions",
        )),
    }
}

fn within(at: &str, number: f32, [low, high]: [f32; 2]) -> Result<(), ParameterError> {
    if (low..=high).contains(&number) {
        return Ok(());
    }
    Err(wrong(
        at,
        format!("{number} found, expected {low} to {high}"),
    ))
}
