//! Files that are made to fill the memory are refused before they do: this program has 2 GiB.

use std::io::Write as _;
use std::path::Path;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use cardiotwin_mesh::files::{LengthUnit, vtu};
use rustix::process::{Resource, Rlimit, setrlimit};

/// Limits the address space of this whole program, in which nothing else is tested.
fn limit_memory() {
    let bytes = Some(2 << 30);
    let limit = Rlimit {
        current: bytes,
        maximum: bytes,
    };
    setrlimit(Resource::As, limit).unwrap();
}

/// A compressed array: a header of one block, and the block.
fn packed(bytes: &[u8]) -> String {
    let mut block = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::best());
    block.write_all(bytes).unwrap();
    let block = block.finish().unwrap();
    let header = [1, bytes.len() as u64, 0, block.len() as u64].map(u64::to_le_bytes);
    format!(
        "{}{}",
        STANDARD.encode(header.concat()),
        STANDARD.encode(block)
    )
}

/// What is said about a file with so many points, whose coordinates are this array.
fn refused(n_points: u64, array: &str) -> String {
    let text = format!(
        r#"<VTKFile type="UnstructuredGrid" byte_order="LittleEndian" header_type="UInt64" compressor="vtkZLibDataCompressor">
<UnstructuredGrid><Piece NumberOfPoints="{n_points}" NumberOfCells="1">
<Points><DataArray type="Float64" Name="Points" NumberOfComponents="3" format="binary">{array}</DataArray></Points>
<Cells/></Piece></UnstructuredGrid></VTKFile>"#
    );
    vtu::parse(
        text.as_bytes(),
        Path::new("hostile.vtu"),
        LengthUnit::Millimetre,
    )
    .unwrap_err()
    .to_string()
}

#[test]
fn a_small_file_of_very_many_points_is_refused_before_it_is_unpacked() {
    limit_memory();
    // 14 MB of such blocks would be 8 GB of zeros.
    let zeros = packed(&vec![0; 1 << 20]);
    for n_points in [333_000_000, u64::MAX / 2] {
        let said = refused(n_points, &zeros);
        assert!(
            said.contains("hostile.vtu:3") && said.contains("numbers in so small a file"),
            "{said}"
        );
        assert!(
            said.contains("at most 256 MiB together"),
            "the limit: {said}"
        );
        assert!(said.contains("without compression"), "the remedy: {said}");
    }
}

#[test]
fn an_array_that_unpacks_to_more_than_its_numbers_is_refused() {
    limit_memory();
    let said = refused(4, &packed(&vec![0; 64 << 20]));
    assert!(
        said.contains("the array Points of more numbers") && said.contains("12 numbers"),
        "{said}"
    );
}
