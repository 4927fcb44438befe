"""Interface for programs and notebooks; `import gateway` offers all of it."""
