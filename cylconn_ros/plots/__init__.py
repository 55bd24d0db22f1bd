"""Pictures of runs, drawn with matplotlib, which is imported only when a picture is asked for."""
