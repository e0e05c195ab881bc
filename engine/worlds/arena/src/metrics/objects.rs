//! Metrics of objects in a tick, for a vector of lanes at a time.

use swarmwright_lanes::{Lanes, Number, number};

use crate::bodies::Bodies;
use crate::place::Place;

/// Returns how many objects are on a patch, and how many there are: those with a name, or all.
#[inline(always)]
pub(super) fn on<L: Lanes>(
    bodies: &Bodies<L>,
    layout: &Place,
    patch: &str,
    name: Option<&str>,
) -> (Number<L>, usize) {
    let (mut count, mut all) = (number(0.0), 0);
    let Some(patch) = layout.patch(patch) else {
        return (count, all);
    };
    let objects = &bodies.objects;
    for index in 0..objects.things.len() {
        if is_named(layout, objects.things[index].kind, name) {
            let moving = &objects.moving[index];
            all += 1;
            count = count.add_where(number(1.0), patch.shape.holds(moving.x, moving.y));
        }
    }
    (count, all)
}

/// Returns how many objects are held by robots, and how many there are: those with a name, or all.
#[inline(always)]
pub(super) fn held<L: Lanes>(
    bodies: &Bodies<L>,
    layout: &Place,
    name: Option<&str>,
) -> (Number<L>, usize) {
    let (mut count, mut all) = (number(0.0), 0);
    let objects = &bodies.objects;
    for index in 0..objects.things.len() {
        if is_named(layout, objects.things[index].kind, name) {
            all += 1;
            count = count.add_where(number(1.0), objects.is_held(index));
        }
    }
    (count, all)
}

/// Returns the sum of the objects' distances from the middle of a patch, metres, and how many objects there are.
#[inline(always)]
pub(super) fn distance<L: Lanes>(
    bodies: &Bodies<L>,
    layout: &Place,
    patch: &str,
    name: Option<&str>,
) -> (Number<L>, usize) {
    let (mut sum, mut all) = (number(0.0), 0);
    let Some(patch) = layout.patch(patch) else {
        return (sum, all);
    };
    let [x, y] = patch.shape.middle();
    let objects = &bodies.objects;
    for index in 0..objects.things.len() {
        if is_named(layout, objects.things[index].kind, name) {
            let moving = &objects.moving[index];
            let (dx, dy) = (moving.x - x as f32, moving.y - y as f32);
            all += 1;
            sum += (dx * dx + dy * dy).sqrt();
        }
    }
    (sum, all)
}

#[inline(always)]
fn is_named(layout: &Place, kind: usize, name: Option<&str>) -> bool {
    match name {
        Some(name) => layout.objects[kind].name == name,
        None => true,
    }
}
