//! Wishes become deliveries: in order, once, within bounds, whatever sources do.

#[path = "loading/epochs.rs"]
mod epochs;
#[path = "loading/faults.rs"]
mod faults;
#[path = "loading/model.rs"]
mod model;
#[path = "loading/order.rs"]
mod order;
#[path = "loading/parts.rs"]
mod parts;
mod random;
#[path = "loading/shutdown.rs"]
mod shutdown;
#[path = "loading/sources.rs"]
mod sources;
#[path = "loading/surveys.rs"]
mod surveys;
