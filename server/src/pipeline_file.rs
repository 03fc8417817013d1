//! Opening a device with kernels that an earlier start compiled: the file they are kept in.
//!
//! The file is a convenience: nothing that is wrong with it keeps a device from being opened, and all of it is said.
//! It starts with a checksum, so that drivers see only what one of them made. Start at [`DeviceOpener`].

use earthshine_gpu::{AdapterChoice, CachedPipelines, Given, GpuDevice, GpuError};
use earthshine_tiles::{checksum, write_atomic};
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};

/// Largest file, bytes. Drivers forget no kernel, so that it grows with every version of ours; above it starts anew.
const FILE_BYTES_MAX: usize = 64 << 20;

/// Bytes of the checksum.
const HEAD_BYTES: usize = 8;

/// Which device to open, now and after it was lost, and with what.
#[derive(Debug, Clone)]
pub(crate) struct DeviceOpener {
    choice: AdapterChoice,
    file: Option<PathBuf>,
}

impl DeviceOpener {
    /// `file` keeps compiled kernels; none if empty.
    pub(crate) fn new(choice: AdapterChoice, file: &Path) -> Self {
        let file = (!file.as_os_str().is_empty()).then(|| file.to_owned());
        Self { choice, file }
    }

    /// Opens the device; the file is read before and written after, if there is news.
    ///
    /// # Errors
    /// [`GpuError`]; what is wrong with the file is a warning.
    pub(crate) fn open(&self) -> Result<GpuDevice, GpuError> {
        let Some(file) = &self.file else { return GpuDevice::open(&self.choice) };
        let stored = read(file).unwrap_or_else(|cause| {
            tracing::warn!(?file, %cause, "compiled kernels cannot be read (gpu_pipeline_cache); compiling all");
            Vec::new()
        });
        let (device, CachedPipelines { given, changed }) = GpuDevice::open_cached(&self.choice, &stored)?;
        match given {
            Given::Unsupported => {
                tracing::warn!(
                    adapter = device.name(),
                    "gpu_pipeline_cache has no effect: only Vulkan has it"
                );
            }
            Given::Refused { cause } => {
                tracing::info!(?file, %cause, "compiled kernels do not fit the adapter; all were compiled");
            }
            Given::Nothing | Given::Taken => {}
        }
        if let Some(Err(cause)) = changed.map(|bytes| write(file, &bytes)) {
            tracing::warn!(?file, %cause, "compiled kernels cannot be kept (gpu_pipeline_cache)");
        }
        Ok(device)
    }
}

fn damaged(cause: &str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, cause)
}

/// What [`write()`] wrote; nothing if there is no file.
fn read(path: &Path) -> io::Result<Vec<u8>> {
    match std::fs::metadata(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        // Reading what is no file may never end.
        found if !found.as_ref().is_ok_and(std::fs::Metadata::is_file) => {
            return Err(found.err().unwrap_or_else(|| damaged("it is no file")));
        }
        _ => {}
    }
    let mut bytes = Vec::new();
    std::fs::File::open(path)?.take(FILE_BYTES_MAX as u64 + 1).read_to_end(&mut bytes)?;
    if bytes.len() > FILE_BYTES_MAX {
        return Err(damaged("it is larger than 64 MiB"));
    }
    let (head, rest) = bytes.split_first_chunk::<HEAD_BYTES>().ok_or_else(|| damaged("it is cut off"))?;
    if u64::from_le_bytes(*head) != checksum::hash(rest) {
        return Err(damaged("its checksum is of other bytes"));
    }
    Ok(rest.to_vec())
}

/// Replaces the file at once, or removes it where it would be too large: the next start compiles what is needed by then.
fn write(path: &Path, pipelines: &[u8]) -> io::Result<()> {
    if pipelines.len() > FILE_BYTES_MAX - HEAD_BYTES {
        return match std::fs::remove_file(path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
            _ => Ok(()),
        };
    }
    let bytes = [&checksum::hash(pipelines).to_le_bytes(), pipelines].concat();
    write_atomic(path, &bytes).map_err(io::Error::other)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write as _;

    /// Goal: bytes come back as they were, and no others ever do. Method: a file, cut at every length, with every bit of a
    /// byte changed, larger than allowed, and a folder in its place.
    #[test]
    fn only_what_was_written_is_read() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("cache/kernels");
        assert_eq!(read(&path).expect("no file is no fault"), b"");
        let pipelines = [7, 1, 255, 0, 3];
        write(&path, &pipelines).expect("a folder on the way is made");
        assert_eq!(read(&path).expect("a whole file"), pipelines);
        let whole = std::fs::read(&path).expect("a file");
        for length in 0..whole.len() {
            std::fs::write(&path, &whole[..length]).expect("a file");
            assert!(read(&path).is_err(), "{length} bytes");
        }
        for bit in 0..8 * whole.len() {
            let mut other = whole.clone();
            other[bit / 8] ^= 1 << (bit % 8);
            std::fs::write(&path, other).expect("a file");
            assert!(read(&path).is_err(), "bit {bit}");
        }
        write(&path, &pipelines).expect("a damaged file is replaced");
        assert_eq!(read(&path).expect("a whole file"), pipelines);
        assert!(read(folder.path()).is_err(), "a folder");

        write(&path, &vec![0; FILE_BYTES_MAX - HEAD_BYTES]).expect("as large as may be");
        assert_eq!(read(&path).expect("a whole file").len(), FILE_BYTES_MAX - HEAD_BYTES);
        std::fs::File::options()
            .append(true)
            .open(&path)
            .and_then(|file| file.set_len(FILE_BYTES_MAX as u64 + 1))
            .expect("a file");
        assert!(read(&path).is_err_and(|error| error.to_string().contains("larger")));
        write(&path, &vec![0; FILE_BYTES_MAX]).expect("too large is no fault");
        assert_eq!(read(&path).expect("none"), b"", "the next start begins anew");
    }

    /// Past the test harness, which swallows what passing tests print.
    fn skipped(cause: &str) {
        writeln!(io::stderr(), "SKIPPED a test of stored kernels: {cause}").expect("standard error");
    }

    /// Goal: a file that cannot be used or written never keeps a device from being opened. Method: no file, a damaged
    /// one, a folder in its place.
    #[test]
    fn a_device_is_opened_whatever_the_file_is() {
        let any = AdapterChoice { allow_software: true, ..AdapterChoice::default() };
        if let Err(error) = GpuDevice::open(&any) {
            assert!(std::env::var_os("EARTHSHINE_TEST_GPU_REQUIRED").is_none(), "{error}");
            return skipped(&error.to_string());
        }
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("kernels");
        let opener = DeviceOpener::new(any.clone(), &path);
        opener.open().expect("it was open before");
        if std::fs::metadata(&path).is_err() {
            return skipped("the driver hands out none");
        }
        opener.open().expect("with its own kernels");
        let kept = read(&path).expect("a whole file");
        for damage in [&b"no kernels"[..], &checksum::hash(b"others").to_le_bytes()] {
            std::fs::write(&path, damage).expect("a file");
            opener.open().expect("with none");
            assert!(!kept.is_empty() && !read(&path).expect("replaced").is_empty());
        }
        DeviceOpener::new(any, folder.path()).open().expect("a folder is no file");
    }
}
