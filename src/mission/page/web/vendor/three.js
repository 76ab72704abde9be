// What the page uses of three.js, bundled into three.min.js by build.sh.
export {
    AlwaysStencilFunc,
    BufferAttribute,
    BufferGeometry,
    Color,
    DoubleSide,
    Fog,
    Float32BufferAttribute,
    Group,
    InstancedBufferAttribute,
    InstancedBufferGeometry,
    LineBasicMaterial,
    LineSegments,
    Line,
    MathUtils,
    Matrix4,
    Mesh,
    MeshBasicMaterial,
    NoToneMapping,
    PerspectiveCamera,
    Points,
    PointsMaterial,
    Scene,
    ShaderMaterial,
    Vector2,
    Vector3,
    WebGLRenderer,
} from 'three';
export { OrbitControls } from 'three/examples/jsm/controls/OrbitControls.js';
export { LineSegments2 } from 'three/examples/jsm/lines/LineSegments2.js';
export { LineSegmentsGeometry } from 'three/examples/jsm/lines/LineSegmentsGeometry.js';
export { LineMaterial } from 'three/examples/jsm/lines/LineMaterial.js';
