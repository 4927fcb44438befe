"""Effects that a baseline model may lack, grouped by physics; `catalogue` lists them all."""
