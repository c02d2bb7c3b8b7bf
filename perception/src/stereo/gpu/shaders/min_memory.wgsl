// Minimum energy of a path's pixel over all its lanes, through workgroup memory. Three slots rotate: one is read, one
// is written, one is cleared.
var<workgroup> minima: array<atomic<u32>, 3u * SLOTS>;

fn min_start(thread: u32) {
    if thread < SLOTS {
        atomicStore(&minima[thread], 255u);
    }
}

fn min_before(slot: u32, i: u32, carried: u32) -> u32 {
    return atomicLoad(&minima[(i + 2u) % 3u * SLOTS + slot]);
}

fn min_after(slot: u32, lane: u32, i: u32, least: u32, running: bool) -> u32 {
    if running {
        atomicMin(&minima[i % 3u * SLOTS + slot], least);
        if lane == 0u {
            atomicStore(&minima[(i + 1u) % 3u * SLOTS + slot], 255u);
        }
    }
    return 0u;
}
