//! Results on standard output. A reader that has seen enough (`| head`) ends the program quietly.

use std::io::Write as _;

/// Prints one line.
pub(crate) fn line(text: std::fmt::Arguments<'_>) {
    if let Err(error) = writeln!(std::io::stdout(), "{text}") {
        let is_closed = error.kind() == std::io::ErrorKind::BrokenPipe;
        if !is_closed {
            eprintln!("error: standard output: {error}");
        }
        std::process::exit(if is_closed { 0 } else { i32::from(crate::exit_code::STORAGE) });
    }
}

/// `println!` for results.
macro_rules! out {
    ($($argument:tt)*) => { $crate::output::line(format_args!($($argument)*)) };
}
pub(crate) use out;
