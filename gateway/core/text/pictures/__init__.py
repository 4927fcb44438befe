"""Scripts and styles that pages share: uPlot, and the pictures of quantities over time that it draws."""
