//! temp
fn main() {
    let t = std::time::Instant::now();
    let mut bin: Vec<u8> =
        [0f32, 0., 0., 1., 0., 0., 0., 1., 0.].iter().flat_map(|f| f.to_le_bytes()).collect();
    for _ in 0..3200 {
        for i in 0..3u16 {
            bin.extend(i.to_le_bytes());
        }
    }
    let n = 3125;
    let off = bin.len();
    for i in 0..n {
        for f in [i as f32, 0., 0.] {
            bin.extend(f.to_le_bytes());
        }
    }
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0,"extensions":{{"EXT_mesh_gpu_instancing":{{"attributes":{{"TRANSLATION":2}}}}}}}}],"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1}}]}}],"accessors":[{{"bufferView":0,"componentType":5126,"type":"VEC3","count":3}},{{"bufferView":1,"componentType":5123,"type":"SCALAR","count":9600}},{{"bufferView":2,"componentType":5126,"type":"VEC3","count":{n}}}],"bufferViews":[{{"buffer":0,"byteLength":36}},{{"buffer":0,"byteOffset":36,"byteLength":19200}},{{"buffer":0,"byteOffset":{off},"byteLength":{}}}],"buffers":[{{"byteLength":{}}}]}}"#,
        n * 12,
        bin.len()
    );
    let mut j = json.into_bytes();
    while j.len() % 4 != 0 {
        j.push(b' ');
    }
    while bin.len() % 4 != 0 {
        bin.push(0);
    }
    let mut out = b"glTF".to_vec();
    out.extend(2u32.to_le_bytes());
    out.extend(((28 + j.len() + bin.len()) as u32).to_le_bytes());
    out.extend((j.len() as u32).to_le_bytes());
    out.extend(b"JSON");
    out.extend(&j);
    out.extend((bin.len() as u32).to_le_bytes());
    out.extend(b"BIN\0");
    out.extend(&bin);
    let s = earthshine_scene::load_bytes(&out, "big", &Default::default()).unwrap();
    println!("{} {:?}", s.triangles.len(), t.elapsed());
    println!(
        "{}",
        std::fs::read_to_string("/proc/self/status")
            .unwrap()
            .lines()
            .find(|l| l.starts_with("VmHWM"))
            .unwrap()
    );
    for f in std::env::args().skip(1) {
        let best = (0..5)
            .map(|_| {
                let t = std::time::Instant::now();
                let s = earthshine_scene::load(f.as_ref(), &Default::default()).unwrap();
                drop(s);
                t.elapsed()
            })
            .min()
            .unwrap();
        println!("{f} {best:?}");
    }
}
