//! What a figure was measured on, and how much memory it took.

/// Cores, processor and system, as `bench` prints them.
#[derive(Debug, serde::Serialize)]
pub(crate) struct Machine {
    pub(crate) cores: usize,
    pub(crate) cpu: String,
}

impl Machine {
    /// This machine.
    pub(crate) fn here() -> Self {
        let cpu = std::fs::read_to_string("/proc/cpuinfo")
            .ok()
            .and_then(|text| {
                let line = text.lines().find(|line| line.starts_with("model name"))?;
                Some(line.split_once(':')?.1.trim().to_owned())
            })
            .unwrap_or_else(|| std::env::consts::ARCH.to_owned());
        Self { cores: std::thread::available_parallelism().map_or(1, std::num::NonZero::get), cpu }
    }
}

/// Most memory this process has held at once, bytes; `None` where the system does not say.
pub(crate) fn peak_rss_bytes() -> Option<u64> {
    status_kib("VmHWM").map(|kib| kib * 1024)
}

fn status_kib(key: &str) -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with(key))?;
    line.split_whitespace().nth(1)?.parse().ok()
}
