// Minimum energy of a path's pixel over all its lanes, which belong to one subgroup.

fn min_start(thread: u32) {
}

fn min_before(slot: u32, i: u32, carried: u32) -> u32 {
    return carried;
}

fn min_after(slot: u32, lane: u32, i: u32, least: u32, running: bool) -> u32 {
    var all = least;
    for (var step = 1u; step < LANES; step *= 2u) {
        all = min(all, subgroupShuffleXor(all, step));
    }
    return all;
}
