//! One program file through the rewriter, as a user's is: bytes a second, in constant memory.
//!
//! `cargo run --release -p geoerr-bench --bin gcode_stream -- IN OUT [none|square|tables] [marlin|klipper|rrf] [repeat]`
//!
//! The number of threads is that of `RAYON_NUM_THREADS`, and one more that writes the file. `repeat` reads the file that
//! many times over, each time as a new program would follow in one stream, so that memory is seen at sizes that no disk
//! need hold.

use std::fs::File;
use std::io::{Read, Seek, Write};
use std::sync::mpsc::{channel, sync_channel};
use std::time::Instant;

use geoerr_bench::gcode::{RANGE_MM, bent};
use geoerr_core::gcode::{Firmware, OnUnsupported, Options, Rewriter};

/// As the command line reads.
const CHUNK_BYTES: usize = 1 << 20;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().collect();
    let word = |place: usize| arguments.get(place).map_or("", String::as_str);
    let mut source = File::open(word(1))?;
    let mut target = File::create(word(2))?;
    let firmware = match word(4) {
        "marlin" => Some(Firmware::Marlin),
        "klipper" => Some(Firmware::Klipper),
        "rrf" => Some(Firmware::RepRapFirmware),
        _ => None,
    };
    let n_times: u32 = word(5).parse().unwrap_or(1);
    let options = Options {
        model_name: "bench".to_owned(),
        on_unsupported: OnUnsupported::Pass,
        firmware,
        ..Options::for_range([RANGE_MM; 3])
    };
    let mut rewriter = Rewriter::new(bent(word(3)), options)?;
    let begin = Instant::now();
    let n_read = std::thread::scope(|scope| -> Result<usize, Box<dyn std::error::Error>> {
        // As the package does: a block is written while the next one is worked out.
        let (give, take) = sync_channel::<Vec<u8>>(0);
        let (hand_back, empty) = channel::<Vec<u8>>();
        let writing = scope.spawn(move || {
            take.into_iter().try_for_each(|mut block| {
                target.write_all(&block)?;
                block.clear();
                // Where nobody wants it any more, all has been written.
                let _ = hand_back.send(block);
                Ok::<(), std::io::Error>(())
            })
        });
        let mut chunk = vec![0; CHUNK_BYTES];
        let (mut n_read, mut n_left) = (0, n_times);
        while n_left > 0 {
            let n_bytes = source.read(&mut chunk)?;
            n_read += n_bytes;
            if n_bytes == 0 {
                n_left -= 1;
                source.rewind()?;
            }
            rewriter.push(&chunk[..n_bytes], n_left == 0);
            let mut goes_on = true;
            while goes_on {
                let mut out = empty.try_recv().unwrap_or_default();
                let outcome = rewriter.pull(&mut out);
                // Where writing has ended, its error is told below.
                let _ = give.send(out);
                goes_on = outcome?;
            }
        }
        drop(give);
        writing.join().map_err(|_| "writing has ended")??;
        Ok(n_read)
    })?;
    let seconds = begin.elapsed().as_secs_f64();
    let summary = rewriter.summary();
    println!("{:.1} MB/s, {:.3} s", n_read as f64 / 1e6 / seconds, seconds);
    eprintln!("{summary:?}");
    for warning in rewriter.warnings() {
        eprintln!("{warning:?}");
    }
    Ok(())
}
