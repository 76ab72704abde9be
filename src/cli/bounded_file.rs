//! Files that a user names: no more is read than such a file may have, whatever stands there.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

/// The bytes of the file at `path`. A device or a pipe that never ends is refused like a file that is too large.
pub fn read(path: &Path, most_bytes: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    File::open(path)?.take(most_bytes + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > most_bytes {
        return Err(io::Error::new(io::ErrorKind::FileTooLarge, format!("it has more than {most_bytes} bytes")));
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_without_end_is_refused_and_one_of_the_largest_size_is_not() {
        let refused = read(Path::new("/dev/zero"), 1000).unwrap_err();
        assert_eq!(
            (refused.kind(), refused.to_string()),
            (io::ErrorKind::FileTooLarge, "it has more than 1000 bytes".to_owned())
        );
        assert_eq!(read(Path::new("/dev/null"), 0).unwrap(), Vec::<u8>::new());
        let itself = Path::new(env!("CARGO_MANIFEST_DIR")).join("Cargo.toml");
        let size = std::fs::metadata(&itself).unwrap().len();
        assert_eq!(read(&itself, size).unwrap().len() as u64, size);
        assert!(read(&itself, size - 1).is_err());
    }
}
