//! How something stands that somebody else was asked for and nobody waits for: light on its way from a device.

/// Of one question.
#[derive(Debug, Clone, PartialEq)]
pub enum Asked<T> {
    /// The answer has not come yet.
    UnderWay,
    /// The answer, given once.
    Done(T),
    /// No answer will come: it is lost, was given before, or nothing was asked.
    Lost,
}
