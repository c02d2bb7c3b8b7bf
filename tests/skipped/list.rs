//! The last test program of the workspace: prints which tests were skipped, and why.

fn main() {
    // Programs that only ask which tests there are get none.
    if std::env::args().all(|argument| argument != "--list") {
        println!("\n{}", skipped_tests::take_list());
    }
}
