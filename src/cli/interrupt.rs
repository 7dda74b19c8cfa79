//! Ctrl-C and SIGTERM: temporary files go first, then the process ends as it would have.

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::iterator::Signals;

/// From now on, ending the process by these signals leaves no temporary file of a store.
pub fn clean_up_on_signals() {
    // Without a handler the default stays: the process ends, and one temporary file with it stays.
    let Ok(mut signals) = Signals::new([SIGINT, SIGTERM]) else { return };
    std::thread::spawn(move || {
        for signal in signals.forever() {
            crate::store::remove_partial_files();
            let _ = signal_hook::low_level::emulate_default_handler(signal);
        }
    });
}
