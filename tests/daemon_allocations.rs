//! What the daemon's main loop allocates for a request, once it is warm: little, and the same every time, however large the plan is. Plans and fields are written
//! where they are read; their buffers are the workers'.

mod served;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

use overfly::daemon;
use overfly::settings::Settings;
use overfly_client::{Client, EditOrder, PlanOrder};
use served::{PATIENCE, fresh_domain};

thread_local! {
    static IS_COUNTED: Cell<bool> = const { Cell::new(false) };
}

static BYTES: AtomicUsize = AtomicUsize::new(0);
static LARGEST: AtomicUsize = AtomicUsize::new(0);
static CALLS: AtomicUsize = AtomicUsize::new(0);

/// The system's allocator, which counts what the daemon's main loop asks of it.
struct Counting;

#[global_allocator]
static ALLOCATOR: Counting = Counting;

// SAFETY: every call is passed on as it is.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size());
        // SAFETY: as the caller promises.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as the caller promises.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count(size.saturating_sub(layout.size()));
        // SAFETY: as the caller promises.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

fn count(size: usize) {
    if IS_COUNTED.try_with(Cell::get).unwrap_or(false) {
        BYTES.fetch_add(size, Ordering::Relaxed);
        LARGEST.fetch_max(size, Ordering::Relaxed);
        CALLS.fetch_add(1, Ordering::Relaxed);
    }
}

/// What the main loop has allocated in the meantime.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Allocated {
    bytes: usize,
    largest: usize,
    calls: usize,
}

fn during(work: impl FnOnce()) -> Allocated {
    [&BYTES, &LARGEST, &CALLS].into_iter().for_each(|counter| counter.store(0, Ordering::SeqCst));
    work();
    let [bytes, largest, calls] = [&BYTES, &LARGEST, &CALLS].map(|counter| counter.load(Ordering::SeqCst));
    Allocated { bytes, largest, calls }
}

#[test]
fn the_main_loop_allocates_little_for_a_plan_however_large_it_is() {
    let domain = fresh_domain();
    let mut settings = Settings::default();
    (settings.surface.samples, settings.field.viewpoints) = (600, 800);
    let served = domain.clone();
    let daemon = thread::spawn(move || {
        IS_COUNTED.set(true);
        daemon::serve(settings, None, &served)
    });
    let client = Client::connect(&domain, PATIENCE).expect("the daemon answers");
    client.load(served::block(1, 9), Some("block"), &mut |_| {}).expect("a generated block can be loaded");

    // Soon over: once a second the loop looks after dead clients, which allocates more than all the rest.
    let flight = |goal_percent: f64| PlanOrder {
        method: "paper".into(),
        iterations: Some(120),
        goal_percent: Some(goal_percent),
        ..PlanOrder::default()
    };
    let plan = |goal_percent: f64| {
        let mut images = 0;
        let allocated = during(|| {
            let message = client.plan("block", &flight(goal_percent), &mut |_| {}).expect("it can be planned");
            images = message.table().images.len();
        });
        (allocated, images)
    };
    // A busy machine tells more often how far a search is, which allocates too: the least of several requests has little of that.
    let least = |goal_percent: f64| (0..12).map(|_| plan(goal_percent)).min_by_key(|one| one.0.bytes).expect("there are twelve");
    // Warm: services are open, and there are as many plans as are kept.
    (0..40).for_each(|_| {
        plan(20.0);
    });
    let (small, small_images) = least(10.0);
    let (large, large_images) = least(95.0);
    assert!(large_images > 4 * small_images, "{large_images} images and {small_images}");
    // What a plan takes is the size of an image and more for each of its images.
    assert!(large.largest < 8 * 1024 && large.bytes < 96 * 1024, "{large:?}");
    let difference = large.bytes.abs_diff(small.bytes);
    assert!(difference < 64 * (large_images - small_images), "{large:?} for {large_images} images, {small:?} for {small_images}");
    // It does not grow.
    (0..12).for_each(|_| {
        plan(95.0);
    });
    let (later, _) = least(95.0);
    assert!(later.bytes < large.bytes + 4 * 1024, "{later:?} after {large:?}");

    let edit = |number: u32| {
        let structure = client.structures("block").expect("they are listed")[0].name.clone();
        let order = match number % 2 {
            0 => EditOrder::Raise { structure, by_m: 1.0 },
            _ => EditOrder::Lower { structure, by_m: 1.0 },
        };
        during(|| {
            let edited = client.edit("block", &order).expect("it can be edited");
            client.await_replan(&edited, PATIENCE, &mut |_| {}).expect("it can be planned again");
        })
    };
    let edits: Vec<Allocated> = (0..12).map(edit).collect();
    let least = |edits: &[Allocated]| edits.iter().min_by_key(|one| one.bytes).copied().expect("there are edits");
    let (first, last) = (least(&edits[..6]), least(&edits[6..]));
    // The scene is copied for an edit, its structures are not; neither the field nor the plan is.
    assert!(last.largest < 64 * 1024 && last.bytes < 192 * 1024, "{last:?}");
    assert!(last.bytes < first.bytes + 4 * 1024, "{last:?} after {first:?}");
    let status = during(|| drop(client.status().expect("it tells its status")));
    println!("plans {small:?} ({small_images} images), {large:?} ({large_images} images); edits {last:?}; status {status:?}");

    client.stop().expect("it ends");
    daemon.join().expect("it does not panic").expect("it ends well");
}
