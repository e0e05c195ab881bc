//! A step allocates nothing.
#![allow(unsafe_code)] // a counting allocator cannot be written without

use serde_json::json;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use swarmwright_controllers::{Controller, Specification};

struct Counting;

thread_local! {
    static ALLOCATIONS: Cell<usize> = const { Cell::new(0) };
}

// SAFETY: every call goes to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.with(|n| n.set(n.get() + 1));
        // SAFETY: the caller's promise is passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller's promise is passed on.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn a_step_allocates_nothing() {
    let documents = [
        json!({"version": 1, "kind": "layered", "sensors": 4, "actuators": 1, "hidden": [8, 8],
            "activation": "tanh", "output_range": [-1, 1], "weights": vec![0.1; 121]}),
        json!({"version": 1, "kind": "fully_meshed", "sensors": 4, "actuators": 1, "hidden": 3, "iterations": 2,
            "activation": "clamp", "output_range": [0, 1], "weights": vec![0.1; 36]}),
        json!({"version": 1, "kind": "mealy_fsm", "sensors": 4, "actuators": 1, "states": 2,
            "thresholds": [[-0.5, 0.5], [], [0], [0]], "weights": vec![1.0; 48]}),
        json!({"version": 1, "kind": "evostick", "sensors": 4, "actuators": 1, "weights": vec![0.1; 5]}),
        json!({"version": 1, "kind": "hebbian", "sensors": 4, "actuators": 1, "hidden": 2, "iterations": 2,
            "weights": vec![0.1; 25]}),
        json!({"version": 1, "kind": "neat", "sensors": 4, "actuators": 1, "sources": [[0, 4], [0, 1, 4, 5]],
            "iterations": 3, "weights": vec![0.1; 9]}),
        json!({"version": 1, "kind": "growing", "sensors": 4, "actuators": 1, "nodes": 2, "connections": 4,
            "recurrent": true, "output_activation": "tanh", "output_range": [-1, 1], "weights": vec![1.1; 20]}),
    ];
    for document in documents {
        let mut controller =
            Controller::new(&Specification::from_json(&document.to_string()).unwrap());
        let mut actuators = [0.0];
        let before = ALLOCATIONS.with(Cell::get);
        for _ in 0..100 {
            controller
                .step(&[0.1, 0.2, 0.3, 0.4], &mut actuators)
                .unwrap();
        }
        assert_eq!(ALLOCATIONS.with(Cell::get), before);
        let something = std::hint::black_box(vec![0_u8; 8]);
        assert!(ALLOCATIONS.with(Cell::get) > before, "the counter counts");
        drop(something);
    }
}
