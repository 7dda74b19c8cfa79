//! What can be wrong with levels, of rays and of channels.

use crate::{Bad, check_table};

#[rustfmt::skip]
const LEVELS: &[Bad] = &[
    ("level_max = 0", "level_max = @-1", &["level_max", "0 to 31"]),
    ("level_max = 0", "level_max = @32", &["level_max", "0 to 31"]),
    ("level_max = 0", "level_max = @true", &["level_max", "i64"]),
    ("level_max = 0", "level_loss = @1.0", &["level_loss", "less than 1"]),
    ("level_max = 0", "level_loss = @-0.1", &["level_loss", "at least 0"]),
    ("level_max = 0", "level_loss = @nan", &["level_loss", "at least 0"]),
    ("index = 0", "level_min = @32", &["channel 0", "level_min", "0 to 31"]),
    ("index = 0", "level_max = @-1", &["channel 0", "level_max", "0 to 31"]),
    ("index = 0", "sample_every = @3", &["channel 0", "sample_every", "power of two", "3"]),
    ("index = 0", "sample_every = @32", &["channel 0", "sample_every", "1 to 16"]),
    ("index = 0", "sample_every = @-2", &["channel 0", "sample_every", "-2"]),
    ("index = 0", "level_min = 2\nlevel_max = @1", &["channel 0", "at least level_min", "1 and 2"]),
];

#[test]
fn levels_of_rays_and_channels() {
    check_table("bad-levels", LEVELS);
}
