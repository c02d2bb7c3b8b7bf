//! Heap allocations, counted by thread: proof that a stage makes none for a frame.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

/// The system's allocator, which counts. The count costs about a nanosecond and is always on, so that
/// every report tells what its frame has allocated.
#[derive(Clone, Copy, Debug, Default)]
pub struct CountingAllocator;

thread_local! {
    // Constant and without a destructor: to use it allocates nothing.
    static COUNT: Cell<u64> = const { Cell::new(0) };
}

fn count() {
    // A thread that is ending has no count any more; nobody asks for it.
    let _ = COUNT.try_with(|count| count.set(count.get().wrapping_add(1)));
}

/// Memory that this thread has asked for so far: each new piece and each that grew or shrank. 0 where
/// [`CountingAllocator`] is not the program's allocator.
pub fn by_this_thread() -> u64 {
    COUNT.try_with(Cell::get).unwrap_or(0)
}

// SAFETY: every call is passed on to the system's allocator unchanged, and the count touches no heap.
unsafe impl GlobalAlloc for CountingAllocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: the caller keeps the rules of `GlobalAlloc::alloc`, which are those of the system's.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: as above.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count();
        // SAFETY: the pointer came from the system's allocator, through this one, with this layout.
        unsafe { System.realloc(pointer, layout, size) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[global_allocator]
    static ALLOCATOR: CountingAllocator = CountingAllocator;

    #[test]
    fn new_memory_is_counted_and_old_memory_is_not() {
        let before = by_this_thread();
        let mut numbers: Vec<u64> = Vec::with_capacity(8);
        assert_eq!(by_this_thread() - before, 1);
        numbers.extend(0..8);
        numbers.clear();
        numbers.extend(0..8);
        assert_eq!(by_this_thread() - before, 1, "what is there is used again");
        numbers.push(9);
        assert_eq!(by_this_thread() - before, 2, "it grew");
        // Other threads have counts of their own.
        std::thread::scope(|scope| {
            scope.spawn(|| std::hint::black_box(vec![0_u8; 100])).join().unwrap();
        });
        let zeroed = std::hint::black_box(vec![0_u8; 100]);
        assert!(by_this_thread() - before >= 3 && zeroed.len() == 100);
    }
}
