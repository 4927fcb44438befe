// Compile the Kaitai Struct description on standard input, as JSON, to the Python modules on standard output, as JSON.
const compiler = require("kaitai-struct-compiler");

const description = JSON.parse(require("fs").readFileSync(0, "utf-8"));
compiler.compile("python", description, null, false).then(
  (files) => process.stdout.write(JSON.stringify(files)),
  (error) => {
    process.stderr.write(String(error));
    process.exitCode = 1;
  },
);
